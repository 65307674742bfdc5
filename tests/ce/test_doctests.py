"""The examples in ce's docstrings give what they say, and every public name that one calls has one."""

import doctest
import importlib
import inspect
import pkgutil

import pytest

import ce

MODULES = sorted(module.name for module in pkgutil.walk_packages(ce.__path__, "ce."))
ESTIMATING = ("Algorithm", "Estimate", "algorithm", "compare", "estimate", "general_options", "paired")
FAMILIES = (
    "Beta",
    "Exponential",
    "Gumbel",
    "LogNormal",
    "Normal",
    "Product",
    "StandardNormal",
    "TruncatedNormal",
)
OTHERS = (
    "Stream",
    "Uniform",
    "Weibull",
    "draw",
    "present_options",
    "reweighted",
    "sensitivity",
    "variance_ratio",
)


@pytest.mark.parametrize("name", MODULES)
def test_examples_give_what_they_say(name: str):
    assert doctest.testmod(importlib.import_module(name)).failed == 0


@pytest.mark.parametrize(
    "name", [*ESTIMATING, *FAMILIES, *OTHERS, "worst_case", "TruncatedLogNormal", "TwoNormals"]
)
def test_what_one_calls_has_an_example(name: str):
    assert ">>> " in (inspect.getdoc(getattr(ce, name)) or "")
