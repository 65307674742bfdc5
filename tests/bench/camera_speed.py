"""What the camera and the vision ego's network cost on one core.

    python -m tests.bench.camera_speed [--rounds 5] [--json FILE]

Frames of I-80 in the nine weathers of the contact sheet at places along the road, 200 x 66 and 960 x 540 pixels,
without and with depth and labels; then the network, one picture at a time and in batches. Times are processor time of
the thread, so that other work on the machine is not counted, though it takes cache and clock; each frame is taken
--rounds times and the fastest counts. The yardstick, taken in turns with the frames: OpenCV fills the 70 largest
polygons of the same picture (anti-aliased, at 200 x 66). A ratio to it holds on any machine.
"""

import json
import platform
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import click
import cv2
import numpy as np
import onnxruntime

from policies.egos.vision import BESIDE, FRAME_SHAPE, WEIGHTS
from service.world.camera import Camera, Scene, build_scene
from service.world.camera import columns as C
from service.world.camera.sheet import WEATHERS, traffic
from service.world.scenario import load_scenario
from service.world.scenario.check import check_road
from service.world.scenario.schema import CameraSpec
from sumo_nets.corridor import Corridor

SIZES = ((200, 66), (960, 540))
PLACES = 12
YARDSTICK = 70  # polygons
BATCHES = (1, 2, 4, 8, 16)
MS = 1e3


def fastest(call: Callable[[], object], rounds: int) -> float:
    """Milliseconds of processor time of the fastest of some calls."""
    times = []
    for _ in range(rounds):
        began = time.thread_time_ns()
        call()
        times.append(time.thread_time_ns() - began)
    return min(times) / 1e6


def filled(camera: Camera, count: int) -> Callable[[], None]:
    """OpenCV filling the largest of the polygons that `camera` drew last, in a picture of its size."""
    table = camera._polygons[1:count]
    shapes = []
    for row in table:
        n = int(row[C.COUNT])
        corners = 0.5 * np.column_stack([row[C.X : C.X + n], row[C.Y : C.Y + n]])  # samples to pixels
        area = cv2.contourArea(corners.astype(np.float32))
        shapes.append(
            (area, np.clip(16.0 * corners, -(2**20), 2**20).astype(np.int32), (0.0, row[C.LABEL], 90.0))
        )
    largest = sorted(shapes, key=lambda shape: -shape[0])[:YARDSTICK]
    picture = np.zeros((camera.spec.height_px, camera.spec.width_px, 3), np.uint8)

    def fill() -> None:
        for _, corners, colour in largest:
            cv2.fillConvexPoly(picture, corners, colour, cv2.LINE_AA, 4)

    return fill


def frames(scene: Scene, corridor: Corridor, size: tuple[int, int], rounds: int) -> dict:
    """Milliseconds a frame by weather: the mean over places, the worst place, with depth and labels, and yardstick."""
    camera = Camera(CameraSpec(width_px=size[0], height_px=size[1]))
    result = {}
    for name, weather in WEATHERS.items():
        plain, labelled, yard, polygons = [], [], [], []
        for station in np.linspace(60.0, corridor.length_m - 160.0, PLACES):
            poses = traffic(corridor, float(station))
            camera.render(scene, poses, 0, weather)  # a new weather's tables are made
            plain.append(fastest(partial(camera.render, scene, poses, 0, weather, 1, 2), rounds))
            labelled.append(fastest(partial(camera.images, scene, poses, 0, weather, 1, 2), rounds))
            polygons.append(int((camera._polygons[:, C.COUNT] > 0).sum()))
            if size == SIZES[0]:
                yard.append(fastest(filled(camera, polygons[-1]), rounds))
        click.echo(f"{name}: done", err=True)
        result[name] = {
            "ms": float(np.mean(plain)),
            "worst_place_ms": float(np.max(plain)),
            "with_depth_and_labels_ms": float(np.mean(labelled)),
        }
        if yard:
            result[name]["yardstick_ms"] = float(np.mean(yard))
            result[name]["ratio_to_yardstick"] = float(np.mean(plain) / np.mean(yard))
    return result


def network(rounds: int) -> dict:
    """Milliseconds a picture of the shipped network at each batch size, and whether batches give the same bits."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(WEIGHTS), options, providers=["CPUExecutionProvider"])
    rng = np.random.default_rng(0)
    n = max(BATCHES)
    frame = rng.integers(0, 256, (n, *FRAME_SHAPE), dtype=np.uint8)
    beside = rng.uniform(0.0, 50.0, (n, BESIDE)).astype(np.float32)

    def act(first: int, last: int) -> np.ndarray:
        return session.run(None, {"frame": frame[first:last], "beside": beside[first:last]})[0]

    alone = np.concatenate([act(i, i + 1) for i in range(n)])
    result: dict = {
        str(size): fastest(lambda size=size: act(0, size), 10 * rounds) / size for size in BATCHES
    }
    return {"ms_a_picture": result, "same_bits": bool(np.array_equal(act(0, n), alone))}


@click.command()
@click.option("--rounds", type=click.IntRange(1), default=7, show_default=True)
@click.option(
    "--json", "file", type=click.Path(dir_okay=False, path_type=Path), help="Write the figures there too."
)
def main(rounds: int, file: Path | None) -> None:
    cv2.setNumThreads(1)
    scenario = load_scenario("i80")
    corridor = check_road(scenario, scenario.name)
    scene = build_scene(corridor)
    result: dict = {"processor": platform.processor() or platform.machine(), "frames": {}}
    for size in SIZES:
        rows = result["frames"][f"{size[0]}x{size[1]}"] = frames(scene, corridor, size, rounds)
        click.echo(f"{size[0]} x {size[1]}, ms of processor time a frame, mean over {PLACES} places of I-80")
        for name, row in rows.items():
            ratio = f", {row['ratio_to_yardstick']:.2f} x the yardstick" if "yardstick_ms" in row else ""
            click.echo(
                f"  {name:20} {row['ms']:6.3f} (worst place {row['worst_place_ms']:6.3f}), with depth and labels "
                f"{row['with_depth_and_labels_ms']:6.3f}{ratio}"
            )
        if "yardstick_ms" in next(iter(rows.values())):
            yard = np.mean([row["yardstick_ms"] for row in rows.values()])
            click.echo(f"  yardstick: OpenCV fills {YARDSTICK} polygons of the picture in {yard:.3f} ms")
    if WEIGHTS.is_file():
        result["network"] = network(rounds)
        each = ", ".join(f"{size}: {ms:.3f}" for size, ms in result["network"]["ms_a_picture"].items())
        click.echo(
            f"network, ms a picture by batch size: {each}; same bits: {result['network']['same_bits']}"
        )
    if file is not None:
        file.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
