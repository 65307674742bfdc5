"""glTF files as a reader of bytes finds them: colours to the last digit, y up without any node's help."""

from __future__ import annotations

import json
import struct

import numpy as np

from service.world.camera.export import export, meshes


def parts_of(path) -> tuple[dict, bytes]:
    """The JSON and the binary chunk of a .glb file."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + size]), data[20 + size + 8 :]


def test_colours_and_vertices_are_exact_without_nodes(scene, poses, tmp_path):
    export(scene, tmp_path / "road.glb", poses)
    tree, binary = parts_of(tmp_path / "road.glb")
    wanted = meshes(scene, poses)
    colours = {m["name"]: m["pbrMetallicRoughness"]["baseColorFactor"] for m in tree["materials"]}
    albedos = np.unique(np.concatenate([scene.ground.albedo, scene.faces.albedo]).round(6), axis=0)
    found = np.array(list(colours.values()))
    assert set(colours) == set(wanted.geometry)
    apart = np.abs(albedos[:, None] - found[None, :, :3]).max(axis=2).min(axis=1)
    assert apart.max() < 1e-6
    assert (found[:, 3] == 1.0).all()
    for node in tree["nodes"]:
        assert np.allclose(np.array(node.get("matrix", np.eye(4).ravel())), np.eye(4).ravel())
    heights = []
    for mesh in tree["meshes"]:
        for primitive in mesh["primitives"]:
            accessor = tree["accessors"][primitive["attributes"]["POSITION"]]
            view = tree["bufferViews"][accessor["bufferView"]]
            begin = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
            points = np.frombuffer(binary, "<f4", 3 * accessor["count"], begin).reshape(-1, 3)
            heights.append((points[:, 1].min(), points[:, 1].max()))
    z = np.concatenate([mesh.vertices[:, 2] for mesh in wanted.geometry.values()])
    assert abs(min(low for low, _ in heights) - z.min()) < 1e-3
    assert abs(max(high for _, high in heights) - z.max()) < 1e-3
