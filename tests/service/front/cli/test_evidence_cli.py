"""`tailroad evidence` and `verify`: a folder that holds, and every way in which one must not."""

import json
import shutil
import xml.etree.ElementTree
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

import tailroad
from service.analysis.evidence.gather import seal
from service.analysis.evidence.signature import secret_key
from service.front.cli.main import main


def tell(*words: str | Path) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of evidence on a run, with a case."""
    folder = tmp_path_factory.mktemp("evidence")
    tailroad.estimate(
        "i80-paper-10s", ego="idm", gamma=1.5, method="naive", budget=40, measure="ttc-impact",
        out=folder / "trial", workers=1,
    )  # fmt: skip
    (folder / "case.toml").write_text(
        'format = 1\nname = "case"\nunit = "hour"\n[[scenario]]\nname = "s"\nexposure = 1.0\nrun = "trial"\n'
        '[[claim]]\nname = "c"\nmeasure = "dangerous"\nat_most = 0.9\n'
    )
    answer = tell(
        "evidence", folder / "trial", "--out", folder / "out", "--key", folder / "key.pem",
        "--case", folder / "case.toml", "--reference", "fsm", "--films", "1", "--workers", "1",
    )  # fmt: skip
    assert answer.exit_code == 0, answer.output
    return folder


def test_a_folder_stands_alone_and_holds(made: Path, tmp_path: Path):
    moved = tmp_path / "elsewhere"
    shutil.copytree(made / "out", moved)
    before = {path: path.read_bytes() for path in moved.rglob("*") if path.is_file()}
    answer = tell(
        "verify", moved, "--sample", "2", "--workers", "1", "--public-key", made / "out" / "tailroad.pub"
    )
    assert answer.exit_code == 0, answer.output
    assert "2 of 2 rollouts run again are the same to the bit" in answer.output
    assert "signed with the key given" in answer.output
    assert {path: path.read_bytes() for path in moved.rglob("*") if path.is_file()} == before


def test_the_goals_are_told_and_drawn(made: Path):
    claims = json.loads((made / "out" / "claims.json").read_text())
    page = (made / "out" / "README.md").read_text()
    drawing = (made / "out" / "goals.svg").read_text()
    xml.etree.ElementTree.fromstring(drawing)
    for group in claims["groups"]:
        for claim in group["claims"]:
            assert f"**{claim['id']}** (goal) {claim['says']}" in page
            assert claim["id"] in drawing
            assert (made / "out" / claim["file"]).is_file()
    assert {path.name for path in (made / "out" / "films").iterdir()} == {"trial-naive-rank1.mp4"}


def test_the_case_in_the_folder_gives_the_same_verdict(made: Path, tmp_path: Path):
    shutil.copytree(made / "out", tmp_path / "copy")
    again = json.loads(tell("accept", tmp_path / "copy" / "case.toml", "--json").stdout)
    assert again == json.loads((made / "out" / "acceptance.json").read_text())


def a_byte(folder: Path) -> str:
    path = folder / "runs" / "trial" / "rollouts.sqlite"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))
    return "runs/trial/rollouts.sqlite was changed"


def a_film(folder: Path) -> str:
    (folder / "films" / "trial-naive-rank1.mp4").unlink()
    return "films/trial-naive-rank1.mp4 is missing"


def a_file_more(folder: Path) -> str:
    (folder / "estimates" / "more.json").write_text("{}")
    return "estimates/more.json is not of the evidence"


def a_link(folder: Path) -> str:
    (folder / "README.md").unlink()
    (folder / "README.md").symlink_to(folder / "goals.svg")
    return "README.md is no plain file"


def the_manifest(folder: Path) -> str:
    path = folder / "manifest.json"
    path.write_text(path.read_text().replace("estimates", "Estimates"))
    return "the signature does not hold"


def no_signature(folder: Path) -> str:
    (folder / "manifest.json.minisig").unlink()
    return "manifest.json.minisig is missing"


@pytest.mark.parametrize("change", [a_byte, a_film, a_file_more, a_link, the_manifest, no_signature])
def test_any_change_is_refused_by_name(made: Path, tmp_path: Path, change: Callable[[Path], str]):
    folder = tmp_path / "changed"
    shutil.copytree(made / "out", folder)
    says = change(folder)
    answer = tell("verify", folder, "--sample", "1", "--workers", "1")
    assert answer.exit_code == 2, answer.output
    assert says in answer.output
    assert "Traceback" not in answer.output


def _edited(folder: Path, name: str, edit: Callable[[dict], None]) -> None:
    data = json.loads((folder / name).read_text())
    edit(data)
    (folder / name).write_text(json.dumps(data))


def no_support(folder: Path) -> str:
    _edited(folder, "claims.json", lambda c: c["groups"][0]["claims"][1].update(value=[0.0, 1e-9]))
    return "claim G2.2"


def no_such_file(folder: Path) -> str:
    _edited(folder, "claims.json", lambda c: c["groups"][0]["claims"][2].update(file="nowhere.json"))
    return "claim G2.3"


def no_claim(folder: Path) -> str:
    _edited(folder, "claims.json", lambda c: c["groups"][0].update(claims=[]))
    return "goal G2"


def another_estimate(folder: Path) -> str:
    def better(estimate: dict) -> None:
        estimate["p"] = 1e-9

    _edited(folder, "estimates/trial-naive.json", better)
    return "estimates/trial-naive.json is not what the record"


@pytest.mark.parametrize("change", [no_support, no_such_file, no_claim, another_estimate])
def test_a_claim_without_support_fails_even_where_it_is_signed(
    made: Path, tmp_path: Path, change: Callable[[Path], str]
):
    folder = tmp_path / "signed"
    shutil.copytree(made / "out", folder)
    says = change(folder)
    seal(folder, secret_key(made / "key.pem")[0], "2026-11-30T00:00:00+00:00")
    answer = tell("verify", folder, "--sample", "0", "--workers", "1")
    assert answer.exit_code == 2, answer.output
    assert says in answer.output


def test_another_signer_is_refused_where_one_is_trusted(made: Path, tmp_path: Path):
    folder = tmp_path / "forged"
    shutil.copytree(made / "out", folder)
    seal(folder, secret_key(tmp_path / "forger.pem")[0], "2026-11-30T00:00:00+00:00")
    answer = tell("verify", folder, "--public-key", made / "out" / "tailroad.pub", "--sample", "0")
    assert answer.exit_code == 2
    assert "another key" in answer.output


def test_what_cannot_be_gathered_is_told_in_a_sentence(made: Path, tmp_path: Path):
    out = tell("evidence", made / "trial", "--out", made / "out", "--key", made / "key.pem")
    assert (out.exit_code, "exists already" in out.output) == (2, True)
    (tmp_path / "empty").mkdir()
    out = tell("evidence", tmp_path / "empty", "--out", tmp_path / "out", "--key", made / "key.pem")
    assert out.exit_code == 2
    assert not (tmp_path / "out").exists()
    (tmp_path / "case.toml").write_text(
        (made / "case.toml").read_text().replace('"trial"', json.dumps(str(made / "other")))
    )
    shutil.copytree(made / "trial", made / "other")
    out = tell(
        "evidence", made / "trial", "--out", tmp_path / "out", "--key", made / "key.pem", "--films", "0",
        "--case", tmp_path / "case.toml", "--reference", "fsm", "--workers", "1",
    )  # fmt: skip
    assert (out.exit_code, "give this run, too" in out.output) == (2, True)
    out = tell("verify", made / "trial", "--public-key", made / "out" / "tailroad.pub")
    assert (out.exit_code, "folders of evidence" in out.output) == (2, True)
