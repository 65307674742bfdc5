"""The files for containers, Kubernetes and Slurm, checked by schemas and lint tools."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

DEPLOY = Path(__file__).parents[2] / "deploy"
MANIFESTS = sorted(p for p in (DEPLOY / "kubernetes").rglob("*.yaml") if p.name != "kustomization.yaml")
KUSTOMIZATIONS = sorted((DEPLOY / "kubernetes").rglob("kustomization.yaml"))
TOOLS = Path(sys.executable).parent


def run(*command: object) -> subprocess.CompletedProcess:
    return subprocess.run([str(c) for c in command], capture_output=True, text=True, check=False)


def documents(path: Path) -> list[dict]:
    return [d for d in yaml.safe_load_all(path.read_text(encoding="utf-8")) if d]


def test_the_image_is_built_from_every_package_that_is_installed():
    project = tomllib.loads((DEPLOY.parent / "pyproject.toml").read_text(encoding="utf-8"))
    packages = {name.rstrip("*") for name in project["tool"]["setuptools"]["packages"]["find"]["include"]}
    lines = (DEPLOY / "container" / "Containerfile").read_text(encoding="utf-8").splitlines()
    copied = {line.split()[1] for line in lines if line.startswith("COPY ") and len(line.split()) == 3}
    assert packages <= copied


@pytest.mark.parametrize("path", MANIFESTS, ids=lambda p: p.stem)
def test_manifests_fit_kubernetes_schemas(path):
    done = run(TOOLS / "kubernetes-validate", "--strict", path)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("path", KUSTOMIZATIONS, ids=lambda p: p.parent.name)
def test_every_resource_of_a_kustomization_is_there(path):
    (kustomization,) = documents(path)
    assert [r for r in kustomization["resources"] if not (path.parent / r).exists()] == []
    listed = {path.parent / r for r in kustomization["resources"]}
    assert set(path.parent.glob("*.yaml")) - {path} <= listed


def test_the_compose_file_fits_its_schema():
    path = DEPLOY / "compose" / "compose.yaml"
    done = run(TOOLS / "check-jsonschema", "--builtin-schema", "vendor.compose-spec", path)
    assert done.returncode == 0, done.stdout + done.stderr


SCRIPTS = ("zenoh/make-security", "slurm/tailroad.sbatch", "examples/http-gateway/build")


@pytest.mark.parametrize("path", [DEPLOY / script for script in SCRIPTS], ids=lambda p: p.name)
def test_shell_scripts_are_clean(path):
    done = run(TOOLS / "shellcheck", path)
    assert done.returncode == 0, done.stdout


def test_the_containerfile_is_clean():
    done = run(TOOLS / "hadolint", DEPLOY / "container" / "Containerfile")
    assert done.returncode == 0, done.stdout


def containers() -> list[dict]:
    pods = [
        d["spec"]["template"]["spec"]
        for p in MANIFESTS
        for d in documents(p)
        if "template" in d.get("spec", {})
    ]
    return [c for pod in pods for c in pod["containers"]]


def test_no_container_runs_as_root_or_writes_where_it_should_not():
    for container in containers():
        security = container["securityContext"]
        assert security["allowPrivilegeEscalation"] is False
        assert security["capabilities"]["drop"] == ["ALL"]
        if container["image"] == "tailroad":
            assert security["readOnlyRootFilesystem"] is True


def test_the_database_s_address_replaces_that_of_sqlite():
    (patch,) = documents(DEPLOY / "kubernetes" / "postgres" / "kustomization.yaml")[0]["patches"]
    (operation,) = yaml.safe_load(patch["patch"])
    assert operation["path"] == "/spec/template/spec/containers/0/env/0"
    (scheduler,) = (c for c in containers() if c["name"] == "scheduler")
    assert scheduler["env"][0]["name"] == operation["value"]["name"] == "TAILROAD_STORE"
