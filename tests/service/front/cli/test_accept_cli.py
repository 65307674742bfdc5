"""`tailroad accept`: verdicts, what it would take, exit codes, and bad cases told in a sentence."""

import json
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner, Result

import tailroad
from service.analysis.acceptance.objects import Acceptance
from service.front.cli.main import main

HEAD = 'format = 1\nname = "trial"\nunit = "hour"\n'
SCENARIO = '[[scenario]]\nname = "a"\nexposure = 2.0\ncounts = { contact = [0, 10_000] }\n'
CLAIM = '[[claim]]\nname = "c"\nmeasure = "contact"\nat_most = 1e-3\n'


def tell(*words: str | Path) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


def judged(folder: Path, text: str, code: int) -> Acceptance:
    (folder / "case.toml").write_text(text)
    answer = tell("accept", folder / "case.toml", "--fail-unless", "met", "--json")
    assert answer.exit_code == code, answer.output
    return msgspec.convert(json.loads(answer.stdout), Acceptance)


def test_a_claim_is_met_not_met_or_undecided(tmp_path: Path):
    met = judged(tmp_path, HEAD + SCENARIO + CLAIM, 0)
    assert met.verdict == "met"
    assert met.claims[0].upper == pytest.approx(2.0 * 3.0e-4, rel=0.01)
    assert judged(tmp_path, HEAD + SCENARIO.replace("[0,", "[90,") + CLAIM, 1).verdict == "not met"
    both = HEAD + SCENARIO + CLAIM + CLAIM.replace('"c"', '"d"').replace("1e-3", "1e-5")
    undecided = judged(tmp_path, both, 4)
    assert [claim.verdict for claim in undecided.claims] == ["met", "undecided"]
    needed = undecided.claims[1].needed
    assert needed is not None
    assert needed.more["a"] == pytest.approx(2.0 * 3.0 / 1e-5, rel=0.02)  # zero events all the way
    printed = tell("accept", tmp_path / "case.toml")
    assert printed.exit_code == 0  # without --fail-unless
    assert "To decide" in printed.output


def test_a_fleet_is_held_against_people(tmp_path: Path):
    claim = (
        '[[claim]]\nname = "c"\nmeasure = "contact"\nat_most_times = 1.0\n'
        'human = { events = 30, exposure = 10_000.0, source = "a count" }\n'
    )
    found = judged(tmp_path, HEAD + SCENARIO + claim, 0).claims[0]
    assert found.of_human
    assert found.upper is not None
    assert 0.0 < found.upper < 1.0
    assert "a count" in found.human


def test_a_run_tells_of_events_contacts_and_injuries(tmp_path: Path):
    run = tailroad.estimate(
        "i80-paper-10s", ego="idm", gamma=2.0, method="naive", budget=60, measure="ttc-impact",
        out=tmp_path / "run", workers=1,
    )  # fmt: skip
    text = HEAD + SCENARIO.replace("counts = { contact = [0, 10_000] }", 'run = "run"')
    text += CLAIM.replace('"contact"', '"dangerous"')
    text += CLAIM.replace('"c"', '"d"') + CLAIM.replace('"c"', '"e"').replace('"contact"', '"injury"')
    text += CLAIM.replace('"c"', '"f"').replace('"contact"', '"preventable:fsm"')
    found = {claim.claim: claim for claim in judged(tmp_path, text, 1).claims}
    assert found["c"].value == pytest.approx(2.0 * run.estimate.p)
    assert found["c"].ci == pytest.approx([2.0 * end for end in run.estimate.ci], rel=5e-3)
    assert found["d"].value == found["e"].value == 0.0  # no contact in 60
    assert found["f"].value <= found["c"].value


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("format = 2\n" + HEAD[11:] + SCENARIO + CLAIM, "reads 1"),
        (HEAD + CLAIM, "scenario"),
        (HEAD + SCENARIO + SCENARIO + CLAIM, "same name"),
        (HEAD + SCENARIO.replace("2.0", "-2.0") + CLAIM, "exposure = -2.0"),
        (HEAD + SCENARIO.replace("[0, 10_000]", "[3, 2]") + CLAIM, "EVENTS|events"),
        (HEAD + SCENARIO + CLAIM.replace('"contact"', '"luck"'), "luck"),
        (HEAD + SCENARIO + CLAIM.replace("at_most = 1e-3", ""), "at_most"),
        (HEAD + SCENARIO + CLAIM.replace("at_most", "at_most_times"), "human"),
        (HEAD + SCENARIO + CLAIM.replace('"contact"', '"injury"'), "says nothing"),
        (HEAD + SCENARIO + CLAIM + "surprise = 1\n", "surprise"),
        ("format = [", "no TOML"),
        (HEAD + SCENARIO.replace("counts = { contact = [0, 10_000] }", 'run = "nowhere"') + CLAIM, "nowhere"),
    ],
)
def test_a_bad_case_is_told_in_a_sentence(tmp_path: Path, text: str, says: str):
    import re

    (tmp_path / "case.toml").write_text(text)
    answer = tell("accept", tmp_path / "case.toml")
    assert answer.exit_code == 2
    assert re.search(says, answer.output), answer.output
    assert "Traceback" not in answer.output
