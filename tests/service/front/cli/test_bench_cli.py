"""`tailroad bench` without --ego: each ego once, those that are another by name alone left out."""

from policies.egos import ego_digest, ego_names
from service.front.cli.bench import distinct_egos


def test_egos_that_drive_by_the_same_weights_are_measured_once():
    names = distinct_egos()
    assert "idm" in names
    digests = [ego_digest(name) for name in names]
    assert len(set(digests)) == len(digests)
    assert set(digests) == {ego_digest(name) for name in ego_names()}
