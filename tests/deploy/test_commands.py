"""Every tailroad command in the deployment files and their page exists, with its options."""

import re
from pathlib import Path

import click
import pytest
import yaml

from service.front.cli.main import main

DEPLOY = Path(__file__).parents[2] / "deploy"


def arguments() -> list[list[str]]:
    """Of every container that runs tailroad."""
    manifests = [
        d for p in (DEPLOY / "kubernetes").rglob("*.yaml") for d in yaml.safe_load_all(p.read_text("utf-8"))
    ]
    pods = [d["spec"]["template"]["spec"] for d in manifests if "template" in d.get("spec", {})]
    return [c["args"] for pod in pods for c in pod["containers"] if c["image"] == "tailroad"]


def commands_used() -> list[list[str]]:
    """Every tailroad command line in these files: [subcommand, options]."""
    compose = yaml.safe_load((DEPLOY / "compose" / "compose.yaml").read_text("utf-8"))["services"]
    found = arguments()
    found += [s["command"] for s in compose.values() if s.get("image", "").startswith("tailroad")]
    found.append(compose["scheduler"]["healthcheck"]["test"][2:])
    script = (DEPLOY / "slurm" / "tailroad.sbatch").read_text(encoding="utf-8").replace("\\\n", " ")
    found += [line.split() for line in re.findall(r"^\s*tailroad (.*?)&?$", script, re.M)]
    found += [line.split() for line in re.findall(r"tailroad ((?:serve|worker) .*?)&?$", script, re.M)]
    text = (DEPLOY / "README.md").read_text(encoding="utf-8")
    blocks = "\n".join(re.findall(r"```\n(.*?)```", text, re.S)).replace("\\\n", " ")
    found += [line.split("#")[0].split() for line in re.findall(r"^tailroad (.*)$", blocks, re.M)]
    return found


@pytest.mark.parametrize("words", commands_used(), ids=" ".join)
def test_commands_used_here_exist_with_their_options(words):
    command = main.get_command(click.Context(main), words[0])
    assert command is not None
    options = {word.split("=")[0] for word in words[1:] if word.startswith("--")}
    assert options <= {name for p in command.params for name in p.opts}
