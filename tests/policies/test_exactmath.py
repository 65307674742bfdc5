"""Elementary functions against extended-precision references, and what the compiler made of them."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import njit
from scipy import stats
from scipy.special import ndtri

from policies import exactmath

N = 100_000


def ulps(got: np.ndarray, reference: np.ndarray) -> float:
    """Largest error of float64 `got` against an extended-precision `reference`, in units of its last place."""
    spacing = np.spacing(np.abs(reference).astype(np.float64))
    return float((np.abs(got.astype(np.longdouble) - reference) / spacing).max())


@njit
def _sincos_all(x):
    out = np.empty((2, x.size))
    for i in range(x.size):
        out[0, i], out[1, i] = exactmath.sincos(x[i])
    return out


def _all_of(function):
    """A kernel of one number, for arrays."""

    @njit
    def every(x):
        return np.array([function(v) for v in x])

    return every


_exp_all = _all_of(exactmath.exp)
_log_all = _all_of(exactmath.log)
_quantile_all = _all_of(exactmath.normal_quantile)
_tail_all = _all_of(exactmath.normal_tail)
_arcsine_all = _all_of(exactmath.arcsine)


def uniform(low: float, high: float, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(low, high, N)


@pytest.mark.parametrize("reach", [0.8, 7.0, 100.0, 1e4])
def test_sine_and_cosine_are_within_two_ulps(reach):
    x = uniform(-reach, reach)
    sine, cosine = _sincos_all(x)
    wide = x.astype(np.longdouble)
    far = np.abs(np.sin(wide)) > 1e-3  # elsewhere the reference's own argument reduction shows
    assert ulps(sine[far], np.sin(wide[far])) < 2.0
    far = np.abs(np.cos(wide)) > 1e-3
    assert ulps(cosine[far], np.cos(wide[far])) < 2.0


@pytest.mark.parametrize("turns", [1, 2, 3, 4, 101, 10_000, 600_000])
def test_sine_and_cosine_near_their_zeros_are_exact_to_1e_16(turns):
    x = turns * (math.pi / 2) + np.linspace(-1e-3, 1e-3, 2001)
    sine, cosine = _sincos_all(x)
    assert np.abs(sine - np.sin(x)).max() < 2.3e-16
    assert np.abs(cosine - np.cos(x)).max() < 2.3e-16


def test_sine_and_cosine_of_a_large_angle_stay_on_the_unit_circle():
    sine, cosine = _sincos_all(uniform(-1e6, 1e6))
    assert np.abs(sine * sine + cosine * cosine - 1.0).max() < 5e-16


def test_sine_is_odd_and_cosine_even_to_the_bit():
    # away from the borders between quadrants, where x and -x may be reduced by different multiples
    x = uniform(0.0, 50.0)
    plus, minus = _sincos_all(x), _sincos_all(-x)
    assert np.array_equal(plus[0], -minus[0])
    assert np.array_equal(plus[1], minus[1])


@pytest.mark.parametrize(("low", "high"), [(-5.0, 0.5), (-1e-8, 1e-8), (-700.0, 700.0)])
def test_exp_is_within_an_ulp_and_a_half(low, high):
    x = uniform(low, high)
    assert ulps(_exp_all(x), np.exp(x.astype(np.longdouble))) < 1.5


@pytest.mark.parametrize(("low", "high"), [(1e-16, 1.0), (0.9, 1.1), (1.0, 1e9)])
def test_log_is_within_three_ulps(low, high):
    x = uniform(low, high)
    assert ulps(_log_all(x), np.log(x.astype(np.longdouble))) < 3.0


def test_log_of_very_small_numbers():
    x = 10.0 ** uniform(-300.0, -1.0)
    assert ulps(_log_all(x), np.log(x.astype(np.longdouble))) < 3.0


@pytest.mark.parametrize(
    ("low", "high"), [(0.0, 1.0), (0.07, 0.08), (0.0, 1e-3), (0.0, 1e-10), (0.0, 2.0**-52)]
)
def test_normal_quantile_agrees_with_scipy_to_a_few_ulps(low, high):
    p = uniform(low, high)
    p = p[p > 0.0]
    got, reference = _quantile_all(p), ndtri(p)
    assert np.abs(got - reference).max() <= 2e-15 * max(1.0, np.abs(reference).max())
    large = np.abs(reference) > 0.1
    assert np.abs(got[large] / reference[large] - 1.0).max() < 4e-15


def test_normal_quantile_is_antisymmetric_to_the_bit():
    p = (np.random.default_rng(2).integers(1, 2**50, N)) * 2.0**-51  # 1 - p is exact
    assert np.array_equal(_quantile_all(p), -_quantile_all(1.0 - p))


def test_known_values_are_exact():
    assert exactmath.sincos(0.0) == (0.0, 1.0)
    assert exactmath.exp(0.0) == 1.0
    assert exactmath.log(1.0) == 0.0
    assert exactmath.normal_quantile(0.5) == 0.0


def test_the_extreme_bit_patterns_give_finite_opposite_normals():
    out = np.empty(2)
    exactmath.normals_from_bits(np.array([0, 2**64 - 1], dtype=np.uint64), out)
    assert out[0] == pytest.approx(float(ndtri(2.0**-53)), rel=1e-14)
    assert out[1] == -out[0]


def test_random_bits_become_standard_normals():
    bits = np.random.Philox(key=7).random_raw(N)
    out = np.empty(N)
    exactmath.normals_from_bits(bits, out)
    assert stats.kstest(out, "norm").pvalue > 1e-3
    assert np.abs(np.corrcoef(out[:-1], out[1:])[0, 1]) < 5.0 / math.sqrt(N)


# The two kernels that a step consists of, compiled anew (numba does not show the machine code of cached kernels).
INSPECT = """
import json, re, sys
import numba
from numba import types as t
from service.world.sim import step

i, f, f1, f2, f3 = t.int64, t.float64, *(t.Array(t.float64, n, "C") for n in (1, 2, 3))
h1, h2 = (t.Array(t.float32, n, "C") for n in (1, 2))
step.observe.compile((f2, i, i, i, f2, f3, f, f2, f2, f2))
step.advance_all.compile((f2, i, i, f, f, f2, h2, h1, h2, h1, h1, f1, f2, f, i, f2))
fused = numba.njit("f8(f8,f8,f8)", fastmath=True)(lambda a, b, c: a * b + c)
called = numba.njit("f8(f8)")(lambda a: a**0.3)

def facts(kernel):
    text = "\\n".join(kernel.inspect_asm().values())
    symbols = set(re.findall(r"(?:movabsq\\s+\\$|callq?\\s+)([A-Za-z_][\\w.@]*)", text))
    inside = set(re.findall(r"^([A-Za-z_][\\w.]*):", text, re.M))
    return {
        "fused": sorted(set(re.findall(r"\\bvf[n]?m(?:add|sub)\\w*|\\bfn?m(?:add|sub|la|ls)\\b", text))),
        "outside": sorted(s for s in symbols - inside if not s.startswith(("NRT_", "Py", "_Py", "_ZN08NumbaEnv"))),
        "products": len(re.findall(r"\\bv?mul[sp][sd]\\b|\\bfmul\\b", text)),
    }

print(json.dumps({name: facts(k) for name, k in
      {"observe": step.observe, "advance_all": step.advance_all, "fused": fused, "called": called}.items()}))
"""
# no rounding to differ in
EXACT_EVERYWHERE = {
    "floor",
    "frexp",
    "ldexp",
    "numba_frexp",
    "numba_ldexp",
    "fmod",
}
NUMBA_RUNTIME = (
    "numba_unpickle",
    "numba_do_raise",
    "numba_gil_",
    "numba_runtime_",
    "memset",
    "memcpy",
    "memmove",
)


@pytest.fixture(scope="module")
def machine_code(tmp_path_factory: pytest.TempPathFactory) -> dict:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path_factory.mktemp("kernels"))}
    done = subprocess.run(
        [sys.executable, "-c", INSPECT],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
        cwd=Path(__file__).parents[2],
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("kernel", ["observe", "advance_all"])
def test_the_kernels_that_decide_f_contain_no_fused_multiply_add(machine_code, kernel):
    assert machine_code[kernel]["products"] > 20  # it is the kernel's code that was searched
    assert machine_code[kernel]["fused"] == []


@pytest.mark.parametrize("kernel", ["observe", "advance_all"])
def test_the_kernels_that_decide_f_call_no_transcendental_library_function(machine_code, kernel):
    outside = [s for s in machine_code[kernel]["outside"] if not s.startswith(NUMBA_RUNTIME)]
    assert set(outside) <= EXACT_EVERYWHERE


def test_the_search_in_the_machine_code_finds_what_it_looks_for(machine_code):
    assert "pow" in machine_code["called"]["outside"]
    if "fma" not in _processor_flags():
        pytest.skip("this processor has no fused multiply-add for the compiler to use")
    assert machine_code["fused"]["fused"] != []


def _processor_flags() -> set[str]:
    path = Path("/proc/cpuinfo")
    return set(path.read_text(encoding="utf-8").split()) if path.is_file() else set()


def test_the_normal_tail_is_right_to_a_few_in_ten_million():
    z = uniform(-8.0, 30.0)
    np.testing.assert_allclose(_tail_all(z), stats.norm.sf(z), rtol=3e-7)


def test_the_arcsine_inverts_the_sine():
    y = uniform(-0.95, 0.95)
    np.testing.assert_allclose(_arcsine_all(y), np.arcsin(y), atol=1e-15, rtol=1e-15)
