"""The compose files against the Compose Specification, where there is no Compose to ask.

The oracle is the compose-spec package. It knows neither YAML's merge key nor variables, which
Compose resolves before it looks at anything, so that is done here. What docker-compose 1.29 and
Compose v2 themselves say of the files, and do with them: tests/containers.
"""

import importlib.util
import json
import re

import pytest
import yaml
from compose_spec import PyCompose
from helpers_paths import ROOT

FILES = sorted(ROOT.glob("docker-compose*.yml"))


def resolved(text: str, environment: dict[str, str]) -> str:
    """A compose file as JSON, merged and with its variables put in; as strings, as Compose does."""

    def value(found: re.Match[str]) -> str:
        if found[0] == "$$":
            return "$"
        return environment.get(found["name"]) or found["default"] or ""

    variable = r"\$\$|\$\{(?P<name>\w+)(?::-(?P<default>[^}]*))?\}"
    return re.sub(variable, value, json.dumps(yaml.safe_load(text)))


def test_there_are_the_files_that_the_docs_name():
    named = set(re.findall(r"docker-compose[\w.]*\.yml", (ROOT / "docs/hosts.md").read_text()))
    assert {path.name for path in FILES} == named | {"docker-compose.yml"}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
@pytest.mark.parametrize("environment", [{}, {"ENCIRCLE_IMAGE": "lab/encircle:1"}])
def test_the_specification_accepts_every_file(path, environment):
    compose = PyCompose.from_json(resolved(path.read_text(), environment))
    assert compose.services


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_it_would_not_accept_a_misspelt_key(path):
    tree = json.loads(resolved(path.read_text(), {}))
    next(iter(tree["services"].values()))["restrat"] = "no"
    with pytest.raises(ValueError, match="restrat"):
        PyCompose.from_json(json.dumps(tree))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_nothing_is_there_that_1_29_does_not_know(path):
    tree = json.loads(resolved(path.read_text(), {}))
    assert "name" not in tree
    for service in tree["services"].values():
        assert "develop" not in service
        wanted = service.get("depends_on", {})
        assert all(set(terms) == {"condition"} for terms in wanted.values())


def test_the_modules_that_images_compile_are_there():
    names = set(re.findall(r"encircle(?:\.\w+)+", (ROOT / "Dockerfile").read_text()))
    assert {"encircle.cli.main", "encircle.runner.fork_server"} <= names
    assert not [name for name in names if importlib.util.find_spec(name) is None]
