"""The starts of i80-paper-data: fits with known answers, and the scenario that carries them."""

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from click.testing import CliRunner
from scipy.special import psi

from policies.columns import Values
from policies.data import start_fit as F
from policies.data import start_fit_report as R
from policies.data.ngsim_import import import_file
from policies.data.scenes import DataError, read_i80
from service.front.cli.main import main
from service.training.demonstrations import held_out_vehicles
from service.world.scenario import load_scenario


def sample(alpha=3.0, beta=5.0, low=-2.0, high=6.0, n=20_000, vehicles=200, seed=1):
    rng = np.random.default_rng(seed)
    return Values(low + (high - low) * rng.beta(alpha, beta, n), np.arange(n) % vehicles)


def test_the_likelihood_is_solved_exactly():
    a, b = 3.2, 0.7
    found = F.most_likely(psi(a) - psi(a + b), psi(b) - psi(a + b))
    assert found == pytest.approx((a, b), rel=1e-4)


def test_a_known_distribution_is_found_again():
    fit = F.fit_beta(sample(), (-2.0, 6.0), resamples=50)
    # the data's own ends are narrower than the support, so compare distributions, not parameters
    q = np.array([0.05, 0.25, 0.5, 0.75, 0.95])
    truth = -2.0 + 8.0 * np.quantile(np.random.default_rng(7).beta(3.0, 5.0, 400_000), q)
    assert fit.quantile(q) == pytest.approx(truth, abs=0.08)
    assert fit.ks < 0.03
    assert fit.outside < 0.01
    assert fit.alpha_interval[0] < fit.alpha < fit.alpha_interval[1]
    assert fit.beta_interval[0] < fit.beta < fit.beta_interval[1]


def test_the_interval_s_ends_are_quantiles_with_a_margin_within_bounds():
    x = np.linspace(0.0, 1000.0, 1001)
    assert F.ends(x, (-1e9, 1e9)) == pytest.approx((5.0 - 49.5, 995.0 + 49.5))
    assert F.ends(x, (0.0, 700.0)) == (0.0, 700.0)


def test_the_bootstrap_draws_vehicles_not_rows():
    independent, alike = sample(n=2000, vehicles=2000), sample(n=2000, vehicles=2000)
    alike = Values(np.repeat(alike.x[:20], 100), np.repeat(np.arange(20), 100))
    widths = [np.ptp(F.fit_beta(s, (-2.0, 6.0), resamples=100).alpha_interval) for s in (independent, alike)]
    assert widths[1] > 3.0 * widths[0]


@pytest.mark.parametrize(
    "wrong",
    [
        Values(np.zeros(0), np.zeros(0)),
        Values(np.ones(9), np.arange(9)),
        Values(np.arange(9.0), np.zeros(9)),
    ],
)
def test_a_sample_without_spread_is_refused(wrong):
    with pytest.raises(DataError, match="at least 2 vehicles"):
        F.fit_beta(wrong, (0.0, 1.0))


def test_held_out_vehicles_are_those_of_the_drivers_training():
    shipped = Path(F.__file__).parent / "sample"
    scene = read_i80(shipped / "i80_6s.parquet", shipped / "i80_lanes.json")
    assert set(scene.vehicle_id[held_out_vehicles(scene)]) == {
        v for v in scene.vehicle_id if v >= F.TRAIN_BELOW
    }


def test_the_scenario_says_what_was_fitted():
    """Speeds of NGSIM's 16:00 to 16:15: 7.6 m/s in the median, 17 in the HOV lane; spacing about 15 m."""
    scenario = load_scenario("i80-paper-data")
    means = {}
    for vehicle in scenario.vehicles:
        d = scenario.of(vehicle, "speed_mps")
        means[vehicle.lane] = d.low + (d.high - d.low) * d.alpha / (d.alpha + d.beta)
    assert means[1] == pytest.approx(17.7, abs=0.5)
    assert means[3] == pytest.approx(7.0, abs=0.5)
    offset = scenario.of(scenario.vehicles[0], "lane_offset_m")
    assert (offset.low, offset.high) == (-F.OFFSET_BOUND_M, F.OFFSET_BOUND_M)


def write_pack(folder):
    """A small data pack: the shipped 6 s of the I-80 scene, and a made-up Coifman file."""
    shipped = Path(F.__file__).parent / "sample"
    (folder / "scenes").mkdir()
    (folder / "trajectories").mkdir()
    (folder / "scenes/i80_lanes.json").write_bytes((shipped / "i80_lanes.json").read_bytes())
    scene = pl.read_parquet(shipped / "i80_6s.parquet")
    scene.write_parquet(folder / "scenes/i80_carpe_platoon_0400-0415.parquet")
    rng = np.random.default_rng(3)
    rows = [
        {"vehicle_id": v, "frame_id": 10 * k, "local_y_ft": 1250.0 + 40.0 * k, "v_vel_ftps": speed, "v_acc_ftps2": 0.0,
         "lane_id": 1 + v % 6, "preceding": 0, "following": 0}
        for v, speed in enumerate(rng.uniform(10.0, 50.0, 120), start=1)
        for k in range(1, 6)
    ]  # fmt: skip
    pl.DataFrame(rows).write_parquet(folder / F.COIFMAN_FILE)


def test_the_command_writes_pictures_and_numbers_and_prints_toml(tmp_path):
    data, out = tmp_path / "data", tmp_path / "out"
    data.mkdir()
    write_pack(data)
    arguments = ["data", "fit-starts", "--data", str(data), "--out", str(out), "--resamples", "20"]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    assert result.output.startswith("[start]\nstation_m = { distribution = ")
    assert len(list(out.glob("i80-data-*.png"))) == len(F.BOUNDS) == len(R.LABELS)
    report = json.loads((out / "i80-data.json").read_text())
    assert set(report["fits"]) == set(F.BOUNDS)
    speed = report["fits"]["speed_mps"]
    assert speed["vehicles"] == 100
    assert speed["sample_mean"] == pytest.approx(30.0 * 0.3048, rel=0.15)


def test_a_folder_without_the_recordings_ends_with_2(tmp_path):
    arguments = ["data", "fit-starts", "--data", str(tmp_path), "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2
    assert "no such file; --data must name the data pack's folder" in result.output


def test_starts_are_fitted_from_imported_tables_too(tmp_path):
    """The import of the shipped sample: the same offsets as from the sample itself, speeds from the scene."""
    shipped = Path(F.__file__).parent / "sample"
    made = {"scene_id": "i80", "lane_offset_m": 0.0, "heading_est_rad": 0.0, "speed_est_mps": 0.0}
    table = pl.read_parquet(shipped / "i80_6s.parquet")
    table = table.with_columns(pl.lit(v).alias(k) for k, v in made.items() if k not in table.columns)
    table.write_parquet(tmp_path / "i80.parquet")
    import_file(tmp_path / "i80.parquet", tmp_path / "tables")
    found = F.samples(tmp_path / "tables")
    scene = read_i80(shipped / "i80_6s.parquet", shipped / "i80_lanes.json")
    assert set(found) == set(F.BOUNDS)
    assert len(found["lane_offset_m"].x) == pytest.approx(
        (scene.usable[::10] & (scene.lane < 6)[::10]).sum(), rel=0.3
    )
    assert np.median(found["speed_mps"].x) == pytest.approx(np.median(scene.speed[scene.usable]), abs=1.5)
    assert F.main_lanes(scene) == 6
