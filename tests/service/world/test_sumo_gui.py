"""SUMO's own GUI: what is said where there is none, and (long) a rollout in it."""

from __future__ import annotations

import os
import shutil
import subprocess

import pytest

import ce
from service.errors import SimulationError
from service.evaluation.job import Problem, make_job
from service.world.sim import sumo_library


@pytest.fixture
def problem(make_scenario) -> Problem:
    return Problem(
        make_job(make_scenario({"horizon_s = 10.0": "horizon_s = 2.0"}), "idm", 0.5, "naive", 1, {})
    )


def test_without_a_screen_or_a_gui_it_says_so(problem, monkeypatch):
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    with pytest.raises(SimulationError, match="needs a screen, and DISPLAY names none"):
        problem.simulator(gui=True)
    monkeypatch.setattr(sumo_library.shutil, "which", lambda name: None)
    monkeypatch.setattr(sumo_library.sys, "executable", "/nowhere/python")
    with pytest.raises(SimulationError, match="there is no sumo-gui; install SUMO"):
        problem.simulator(gui=True)
    with problem.simulator() as simulator:  # and nothing is left open
        assert simulator is not None


@pytest.mark.long
def test_a_rollout_in_the_gui_has_the_same_bits(problem, monkeypatch, tmp_path):
    """On a screen that nobody sees (Xvfb)."""
    assert shutil.which("Xvfb"), "this test needs Xvfb (Debian package xvfb)"
    read, write = os.pipe()
    screen = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", "1024x768x24"],
        pass_fds=[write],
        stderr=subprocess.DEVNULL,
    )
    try:
        monkeypatch.setenv("DISPLAY", ":" + os.read(read, 16).decode().strip())
        x, noise_seeds = ce.draw(problem.base, 3, "estimate", 0, 0, 1)
        with problem.simulator() as simulator:
            plain = simulator.run(x[0], int(noise_seeds[0]))
        with problem.simulator(gui=True) as simulator:
            assert simulator.run(x[0], int(noise_seeds[0])) == plain
        assert plain.error is None
    finally:
        screen.kill()
        screen.wait()
        os.close(read)
        os.close(write)
