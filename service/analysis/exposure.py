"""How far the ego drives in a rollout of P0: what turns a probability per rollout into a rate per kilometre."""

import contextlib
import hashlib
import math
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import msgspec
import numpy as np
from scipy.special import stdtrit

import ce
from service.analysis.failures.rerun import Rerun, Rerunner
from service.evaluation.job import Job

ROLLOUTS = 40
STREAM = 0x6B6D  # a stream of its own: the same rollouts whatever the job's seed and method


class Exposure(msgspec.Struct, frozen=True, kw_only=True):
    """Kilometres and hours that the ego drives in a rollout, on average under P0."""

    rollouts: int  # that were run to measure it
    km: float
    km_ci: tuple[float, float]  # Student's t
    hours: float
    confidence: float


def exposure_of(
    job: Job, base: ce.Product, rerunner: Rerunner, confidence: float = 0.95, folder: Path | None = None
) -> Exposure | None:
    """Measure it on ROLLOUTS rollouts drawn from P0; None where fewer than two of them run.

    base: the job's P0
    folder: a run directory that keeps the answer
    """
    key = hashlib.sha256(
        msgspec.msgpack.encode(
            (
                version("tailroad"),
                ROLLOUTS,
                confidence,
                job.scenario,
                job.ego,
                job.weights_sha256,
                job.ego_sha256,
            ),
            order="deterministic",
        )
    ).hexdigest()[:16]
    path = None if folder is None else folder / f"exposure-{key}.json"
    if path is not None:
        with contextlib.suppress(OSError, msgspec.MsgspecError, ValueError, RecursionError):
            return msgspec.json.decode(path.read_bytes(), type=Exposure)
    x, noise_seeds = ce.draw(base, STREAM, "estimate", 0, 0, ROLLOUTS)
    found = _mean(rerunner.run(list(zip(x, noise_seeds.tolist(), strict=True))), confidence)
    if path is not None and found is not None:
        with contextlib.suppress(OSError):  # a folder that cannot be written to goes without
            path.write_bytes(msgspec.json.encode(found))
    return found


def _mean(drives: Sequence[Rerun], confidence: float) -> Exposure | None:
    km = [drive.driven_m / 1000.0 for drive in drives if drive.error is None]
    hours = [drive.time_s / 3600.0 for drive in drives if drive.error is None]
    n = len(km)
    if n < 2:
        return None
    mean = float(np.mean(km))
    half = float(stdtrit(n - 1, 0.5 + 0.5 * confidence)) * float(np.std(km, ddof=1)) / math.sqrt(n)
    return Exposure(
        rollouts=n,
        km=mean,
        km_ci=(max(mean - half, 0.0), mean + half),
        hours=float(np.mean(hours)),
        confidence=confidence,
    )
