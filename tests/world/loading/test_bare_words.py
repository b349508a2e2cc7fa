"""Changes whose texts a shell has taken the quotes from: what was meant is told, if it is clear."""

import shlex

import pytest

from encircle.world.loading.bare_words import quoted_change
from encircle.world.loading.load import load
from encircle.world.scenario.errors import ScenarioError


@pytest.mark.parametrize(
    ("change", "quoted"),
    [
        ("a={model=bernoulli, rate=0.6}", """"a={model='bernoulli', rate=0.6}\""""),
        ("a.b={model=gilbert-elliott}", """"a.b={model='gilbert-elliott'}\""""),
        ("a=[{kind=silence, robot=r2, tick=5}]", """"a=[{kind='silence', robot='r2', tick=5}]\""""),
        ("a=[r1,r2 , r3]", """"a=['r1','r2' , 'r3']\""""),
        ("a={b=true, c=inf, d=e}", """"a={b=true, c=inf, d='e'}\""""),
        ("""a={b="x y", c=z}""", """'a={b="x y", c='"'"'z'"'"'}'"""),
        ("a={model='bernoulli', rate=0.6}", None),
        ("a=[1, 2]", None),
        ("a=bernoulli", None),
        ("a={model=bernoulli", None),
        ("a={b=two words}", None),
        ("a={}", None),
        ("a", None),
    ],
)
def test_bare_words_get_quotes_if_it_is_right_then(change, quoted):
    assert quoted_change(change) == quoted


@pytest.mark.parametrize(
    "change",
    [
        "channel.loss={model=bernoulli, rate=0.6}",
        """channel={loss={model=bernoulli, rate=0.6}, delay={model="constant", mean_s=0.2}}""",
    ],
)
def test_what_a_refusal_proposes_is_taken_when_a_shell_has_read_it(change):
    with pytest.raises(ScenarioError) as refused:
        load("sim1", [change])
    _, _, rest = str(refused.value).partition(" (did you mean ")
    (proposed,) = shlex.split(rest.partition("? texts in it")[0])
    assert load("sim1", [proposed]).channel.loss.rate == 0.6


def test_a_value_that_a_later_change_has_replaced_proposes_nothing():
    with pytest.raises(ScenarioError) as refused:
        load("sim1", ["channel.loss={model=bernoulli}", "channel.loss=3"])
    assert "did you mean" not in str(refused.value)


def test_a_title_may_look_like_a_list():
    assert load("sim1", ["title=[draft, mine]"]).title == "[draft, mine]"
