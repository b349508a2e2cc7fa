"""What a policy's name stands for, and what is said of what is no policy."""

import json
import re

import pytest

from encircle.cli.main import main
from encircle.conformance import check_policy
from encircle.conformance.subject import NoSuchPolicy, found

GOOD = """
def head(memory, view, *, share: float = 1.0):
    return memory, view.search
"""
FORMS = {
    "one argument": ("def head(view): pass", "takes view alone", "take memory first"),
    "none": ("def head(): pass", "takes nothing", "what it remembers and its view"),
    "three": ("def head(memory, view, share): pass", "takes memory, view, share", "behind a star"),
    "swapped": ("def head(view, memory): pass", "takes view, memory", "memory comes first"),
    "any": ("def head(*arguments): pass", "any number", "known by name"),
    "any own": ("def head(memory, view, **own): pass", "any own parameters", "name each"),
    "class": ("class head: pass", "is a class", "returns, and is given back"),
    "async": ("async def head(memory, view): pass", "is async", "plain function"),
    "generator": ("def head(memory, view): yield", "yields", "plain function"),
    "number": ("head = 3", "is int, must be a function", "a policy is: def policy(memory"),
}
IMPORTS = {
    "syntax": (
        "x = 1\ndef head(memory, view:\n    pass\n",
        "my_robots.py, line 2",
        "mend that line",
    ),
    "raises": ("x = 1\ny = x / 0\n", "my_robots.py, line 2: ZeroDivisionError", "before it joins"),
    "missing": ("\n\nimport nowhere\n", "line 3: ModuleNotFoundError", "beside the policy's file"),
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_robots.py").write_text(GOOD)
    return tmp_path / "my_robots.py"


@pytest.mark.parametrize("form", FORMS)
def test_what_has_another_form_is_explained(form, here):
    text, said, advice = FORMS[form]
    here.write_text(text)
    function, result = found("my_robots.py:head")
    assert function is None
    assert result.level == "wrong"
    assert said in result.said
    assert advice in result.advice


@pytest.mark.parametrize("kind", IMPORTS)
def test_a_file_that_cannot_be_imported_is_explained_with_the_line(kind, here):
    text, said, advice = IMPORTS[kind]
    here.write_text(text)
    function, result = found("my_robots.py:head")
    assert function is None
    assert said in result.said
    assert advice in result.advice


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("auktion", "did you mean 'auction'?"),
        ("my_robots.py:heat", "did you mean 'head'?"),
        ("my_robot.py:head", "did you mean 'my_robots.py'?"),
        ("my_robots.py", "my_robots.py:head"),
        ("nowhere.py:head", "there is no file nowhere.py"),
        ("no.where:head", "unknown policy"),
        ("/my_robots.py:head", "must lie below the working directory"),
    ],
)
def test_a_name_of_nothing_is_bad_usage_and_the_nearest_is_named(name, near, here, capsys):
    with pytest.raises(NoSuchPolicy, match=re.escape(near)):
        found(name)
    assert main(["check-policy", name]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert near in printed.err
    assert printed.err.count("\n") == 1


def test_a_policy_is_described_with_its_own_parameters(here):
    function, result = found("my_robots.py:head")
    assert callable(function)
    assert result.said == "my_robots.py:head is head(memory, view), own parameters: share"


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (["--set", "share=much"], "--set share = 'much': must be"),
        (["--set", "shore=1.0"], "(did you mean 'share'?)"),
        (["--set", "share"], "must be key=value"),
        ([], "--set share: is missing"),
    ],
)
def test_a_parameter_that_is_not_right_is_bad_usage(settings, said, here, capsys):
    here.write_text(GOOD.replace(" = 1.0", ""))
    assert main(["check-policy", "my_robots.py:head", *settings]) == 2
    printed = capsys.readouterr()
    assert said in printed.err
    assert printed.err.count("\n") == 1


def test_json_is_one_object_and_what_a_policy_prints_is_not_in_it(here, capsys, monkeypatch):
    here.write_text("def head(memory, view):\n    print('here')\n    return memory, None\n")
    assert main(["check-policy", "my_robots.py:head", "--json"]) == 1
    printed = capsys.readouterr()
    answer = json.loads(printed.out)
    assert answer["well"] is False
    assert {finding["check"] for finding in answer["findings"]} == {"policy", "decisions"}
    assert "here" in printed.err


def test_the_exit_status_is_zero_if_all_is_well(capsys, monkeypatch):
    result = check_policy.CheckResult("policy", "ok", "it is one")
    monkeypatch.setattr(check_policy, "examined", lambda *_: iter([result]))
    assert main(["check-policy", "xi-star"]) == 0
    assert capsys.readouterr().out == "ok     policy: it is one\nall is well\n"
