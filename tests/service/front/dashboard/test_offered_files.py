"""A rollout's files: the page offers, the service takes and the library writes the same forms."""

from __future__ import annotations

from typing import get_args, get_type_hints

from service.analysis.rollout_files import FORMATS, RolloutFiles
from service.front.dashboard.pages.rollout import SAID
from service.remote.api.requests import AskExport


def test_every_form_is_offered_taken_and_written():
    assert set(SAID) == set(FORMATS) == set(get_args(get_type_hints(AskExport)["format"]))
    methods = {name for name in vars(RolloutFiles) if not name.startswith("_")}
    assert len(methods) == len(FORMATS)
