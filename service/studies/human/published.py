"""How often people crash and nearly crash: published rates, each with its source, per million vehicle-km.

An involvement is a vehicle in a crash: a crash of two vehicles is two. Rates of crashes are crashes over the miles of
all vehicles; involvement rates count vehicles. Of the 100-Car and SHRP 2 studies the vehicles are those of the studies,
whose crashes and near-crashes are their own involvements.
"""

from typing import Literal, NamedTuple

KM_PER_MILE = 1.609344


class Published(NamedTuple):
    """A published rate.

    name: what it counts, and where
    unit: what one of it is
    per_million_km: lowest and highest, per million vehicle-km; the same where one number is published
    source: who published it, and the figures that it is made of
    """

    name: str
    unit: Literal["crashes", "involvements", "near-crashes"]
    per_million_km: tuple[float, float]
    source: str


def _per_mile(low: float, high: float | None = None) -> tuple[float, float]:
    return low / KM_PER_MILE, (low if high is None else high) / KM_PER_MILE


PUBLISHED = (
    Published("police-reported crashes, USA 2022", "crashes", _per_mile(5.93e6 / 3196e3),
              "NHTSA, DOT HS 813 560: 5.93 million crashes in 3,196 billion vehicle-miles"),
    Published("crashes with those that nobody reports, USA", "crashes", _per_mile(4.2),
              "Blanco et al. 2016, Virginia Tech Transportation Institute: 4.2 per million miles, of two severities"),
    Published("crashed vehicles on freeways, any injury reported", "involvements", _per_mile(0.7, 2.4),
              "Scanlon et al. 2025, arXiv 2508.19425: 0.7 (Phoenix) to 2.4 (Atlanta) per million miles"),
    Published("crashed vehicles, police-reported", "involvements", _per_mile(4.68),
              "Kusano et al. 2024, arXiv 2312.12675: 4.68 per million miles"),
    Published("crashed vehicles, any injury reported", "involvements", _per_mile(2.80),
              "Kusano et al. 2024, arXiv 2312.12675: 2.80 per million miles"),
    Published("crashes of any kind, low speeds and kerbs included", "involvements", (21.0, 21.0),
              "100-Car study, Dingus et al. 2006, DOT HS 810 593: 69 crashes in about 2 million vehicle-miles"),
    Published("near-crashes", "near-crashes", (236.0, 236.0),
              "100-Car study: 760 near-crashes in about 2 million vehicle-miles; 11 to a crash (secondary sources)"),
    Published("near-crashes", "near-crashes", (49.0, 49.0),
              "SHRP 2, Hankey et al. 2016: 2,705 near-crashes; over 34 million vehicle-miles"),
    Published("crashes of any kind, kerb strikes included", "involvements", (28.0, 28.0),
              "SHRP 2, Hankey et al. 2016: 1,549 crashes; over 34 million vehicle-miles"),
)  # fmt: skip
INVOLVEMENTS = (8.0, 28.0)  # per million vehicle-km: where epsilon is set
NEAR_CRASHES = (49.0, 236.0)
NEAR_PER_CRASH = (1.7, 11.0)
