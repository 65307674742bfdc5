"""`tailroad scene export|sheet`: what the camera's world is made of, and what it looks like."""

import json
from pathlib import Path

import click
import numpy as np

from service.front.cli.options import json_option, require_folder, seed_option
from service.world.scenario import load_scenario
from service.world.scenario.check import check_road

FILE = click.Path(dir_okay=False, path_type=Path)


@click.group()
def command() -> None:
    """The scene round a scenario's road: as meshes, and as pictures in several weathers."""


@command.command()
@click.argument("file", type=FILE)
@click.argument("scenario", default="i80")
@seed_option()
@click.option(
    "--vehicles/--no-vehicles", default=True, help="With the vehicles where a rollout of this seed starts."
)
@json_option()
def export(file: Path, scenario: str, seed: int, vehicles: bool, as_json: bool) -> None:
    """Write the scene of SCENARIO as meshes to FILE (.glb, .obj, .ply, .stl), for Blender or any viewer."""
    from service.world.camera import build_scene
    from service.world.camera.export import export as write
    from service.world.camera.start import start_poses

    require_folder(file, "FILE")
    loaded = load_scenario(scenario)
    corridor = check_road(loaded, scenario)
    scene = build_scene(corridor)
    write(scene, file, start_poses(loaded, corridor, seed) if vehicles else None)
    facts = {
        "file": str(file),
        "scenario": loaded.name,
        "faces": len(scene.faces),
        "bytes": file.stat().st_size,
    }
    if as_json:
        click.echo(json.dumps(facts, indent=2))
    else:
        click.echo(
            f"{file}: {facts['faces']} solid faces, road and markings, {file.stat().st_size / 1e6:.1f} MB"
        )


@command.command()
@click.argument("file", type=FILE)
@click.argument("scenario", default="i80")
@seed_option()
@click.option("--station", type=float, default=330.0, show_default=True, help="Where along the road, in m.")
@click.option(
    "--ego-camera", is_flag=True, help="The pictures that the scenario's own camera takes, enlarged."
)
def sheet(file: Path, scenario: str, seed: int, station: float, ego_camera: bool) -> None:
    """Write a contact sheet (.png or .jpg) of the road in several weathers."""
    import cv2

    from service.errors import InputError
    from service.world.camera.sheet import contact_sheet

    require_folder(file, "FILE")
    loaded = load_scenario(scenario)
    corridor = check_road(loaded, scenario)
    if not 0.0 <= station <= corridor.length_m:
        raise InputError(f"--station {station:g}: the road goes from 0 to {corridor.length_m:.0f} m")
    picture = contact_sheet(loaded, corridor, seed, station, ego_camera)
    try:
        quality = [cv2.IMWRITE_JPEG_QUALITY, 84] if file.suffix.lower() in (".jpg", ".jpeg") else []
        written = cv2.imwrite(str(file), np.ascontiguousarray(picture[:, :, ::-1]), quality)
    except cv2.error as error:
        raise InputError(f"{file}: pictures are written as .png or .jpg; give such a file") from error
    if not written:
        raise InputError(f"{file}: cannot be written")
    click.echo(f"{file}: {picture.shape[1]} x {picture.shape[0]}")
