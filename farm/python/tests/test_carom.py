"""Laws of the Python module: what is asked for is traced, what is wrong is told, and nothing hangs."""

import json
import os
import signal
import threading
from pathlib import Path

import numpy as np
import pytest

import carom

ROOT = Path(__file__).resolve().parents[3]
POOL = ROOT / "assets" / "scenes" / "pool.json"


def scene(**fields):
    """A diffuse ball of albedo 1/2 in a white furnace, with some fields replaced."""
    return {
        "camera": {"eye": [0, -4, 0], "target": [0, 0, 0], "up": [0, 0, 1], "fov_x_deg": 44},
        "environment": {"radiance": [1, 1, 1]},
        "materials": {"half": {"diffuse": {"albedo": [0.5, 0.5, 0.5]}}},
        "objects": [
            {"name": "ball", "material": "half", "shape": {"sphere": {"center": [0, 0, 0], "radius": 1}}}
        ],
        **fields,
    }


@pytest.fixture(scope="module")
def farm():
    with carom.Farm(backend="cpu") as farm:
        yield farm


def test_a_furnace_has_the_balls_albedo_and_the_skys_radiance(farm):
    image = farm.render(scene(), (64, 36), 16)
    assert image.shape == (36, 64, 3) and image.dtype == np.float32
    assert image.flags["C_CONTIGUOUS"] and image.flags["WRITEABLE"]
    np.testing.assert_allclose(image[0, 0], 1.0)
    np.testing.assert_allclose(image[18, 32], 0.5, rtol=1e-6)


def test_the_same_arguments_give_the_same_bits_and_another_seed_others(farm):
    first, again, other = (farm.render(POOL, (64, 36), 4, seed=seed) for seed in (7, 7, 8))
    assert np.array_equal(first, again) and not np.array_equal(first, other)


def test_dictionaries_files_and_scenes_are_the_same_scene(farm, tmp_path):
    data = json.loads(POOL.read_text())
    held = carom.Scene(data)
    held.save(tmp_path / "copy.json")
    images = [farm.render(of, (48, 27), 2) for of in (POOL, str(POOL), data, held, tmp_path / "copy.json")]
    assert all(np.array_equal(images[0], image) for image in images[1:])
    assert carom.Scene(held.to_dict()).to_dict() == held.to_dict()
    assert "objects" in repr(held)


def sliding(folder):
    """A glTF file of a triangle that slides along x by 2 m in 2 s."""
    corners, slide, times = [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[-1, 0, 0], [1, 0, 0]], [0, 2]
    data = np.concatenate([np.ravel(part) for part in (corners, slide, times)]).astype("<f4")
    (folder / "slide.bin").write_bytes(data.tobytes())
    accessors = [(0, 3, "VEC3"), (36, 2, "VEC3"), (60, 2, "SCALAR")]
    path = folder / "slide.gltf"
    path.write_text(json.dumps({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "animations": [{
            "name": "slide",
            "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
            "samplers": [{"input": 2, "output": 1}],
        }],
        "accessors": [
            {"bufferView": 0, "byteOffset": offset, "componentType": 5126, "count": count, "type": kind}
            for offset, count, kind in accessors
        ],
        "bufferViews": [{"buffer": 0, "byteLength": data.nbytes}],
        "buffers": [{"uri": "slide.bin", "byteLength": data.nbytes}],
    }))
    return path


def test_files_of_all_kinds_are_opened_by_their_names(farm, tmp_path):
    (tmp_path / "wing.obj").write_text("v 0 0 0\nv 4 0 0\nv 0 3 0\nf 1 2 3\n")
    wing = carom.Scene.load(tmp_path / "wing.obj")
    assert wing.to_dict()["objects"][0]["name"] == "wing"
    assert farm.render(tmp_path / "wing.obj", (32, 18), 1).shape == (18, 32, 3)
    assert carom.Scene.load(POOL).to_dict() == carom.Scene(POOL).to_dict()
    with pytest.raises(ValueError, match="must end with one of"):
        carom.Scene.load(tmp_path / "wing.fbx")


def test_a_glTF_file_is_shown_at_a_time_of_its_animation(farm, tmp_path):
    path = sliding(tmp_path)

    def x(**moment):
        return carom.Scene.load(path, **moment).to_dict()["objects"][0]["shape"]["mesh"]["center"][0]

    assert [x(time=time) for time in (0, 0.5, 1, 9)] == [-1, -0.5, 0, 1]
    assert x(time=2, animation="slide") == x(time=2, animation=0) == 1 and x() == 0
    at_start = farm.render(path, (64, 36), 1, time=0)
    assert not np.array_equal(at_start, farm.render(path, (64, 36), 1, time=2))
    assert np.array_equal(at_start, farm.render(carom.Scene.load(path, time=0), (64, 36), 1))
    for wrong, sentence in (
        ({"animation": "jump"}, "0 `slide`"),
        ({"time": float("nan")}, "the time is NaN s"),
    ):
        with pytest.raises(ValueError, match=sentence):
            carom.Scene.load(path, **wrong)
    with pytest.raises(ValueError, match="it has no animation"):
        carom.Scene.load(POOL, time=1)
    with pytest.raises(ValueError, match="give the path of one"):
        farm.render(scene(), (8, 8), 1, time=1)
    with pytest.raises(TypeError, match="a name or a number"):
        carom.Scene.load(path, animation=[])


def test_arrays_stand_for_lists_in_dictionaries(farm):
    arrays = scene()
    arrays["camera"]["eye"] = np.array([0.0, -4.0, 0.0])
    arrays["camera"]["fov_x_deg"] = np.float64(44)
    assert np.array_equal(farm.render(arrays, (32, 18), 2), farm.render(scene(), (32, 18), 2))


def test_meshes_come_from_arrays_and_files(farm, tmp_path):
    positions = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    quad = carom.Scene(scene(objects=[]))
    quad.add_mesh("quad", positions, [[0, 1, 2], [0, 2, 3]], "half", normals=np.tile([0.0, -1.0, 0.0], (4, 1)))
    image = farm.render(quad, (32, 18), 4)
    np.testing.assert_allclose(image[9, 16], 0.5, rtol=1e-6)
    (tmp_path / "quad.obj").write_text("v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nf 1 2 3 4\n")
    filed = carom.Scene(scene(objects=[]))
    filed.add_mesh_file("quad", tmp_path / "quad.obj", "half")
    filed.look([0, -4, 0], [0, 0, 0])
    assert np.array_equal(farm.render(filed, (32, 18), 4), image)


def test_layers_are_albedo_normal_and_depth(farm):
    layers = farm.render(scene(), (64, 36), 4, layers=True)
    assert {name: array.shape for name, array in layers.items()} == {
        "color": (36, 64, 3),
        "albedo": (36, 64, 3),
        "normal": (36, 64, 3),
        "depth": (36, 64),
    }
    np.testing.assert_allclose(layers["albedo"][18, 32], 0.5, rtol=1e-3)
    np.testing.assert_allclose(layers["normal"][18, 32], [0, -1, 0], atol=0.05)
    assert abs(layers["depth"][18, 32] - 3) < 0.01 and np.isinf(layers["depth"][0, 0])


def test_denoising_lowers_the_error(farm):
    reference = farm.render(POOL, (96, 54), 256, seed=1)
    noisy, clean = (farm.render(POOL, (96, 54), 2, seed=2, denoise=denoise) for denoise in (False, True))
    assert np.mean((clean - reference) ** 2) < np.mean((noisy - reference) ** 2)


def test_srgb_is_the_games_tone_curve():
    image = np.array([[[0.0, 0.214_041_14, 0.6], [1.0, 1.0, 1.0]]], dtype=np.float64)
    assert carom.srgb(image).tolist() == [[[0, 128, 203], [237, 237, 237]]]
    assert carom.srgb(image, exposure=0.0).max() == 0


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        (scene(colour="red"), "colour"),
        (scene(camera={"eye": [0, 0, 0], "target": [0, 0, 0], "up": [0, 0, 1], "fov_x_deg": 44}), "camera"),
        (scene(environment={"radiance": [float("nan"), 1, 1]}), "JSON compliant"),
        ("no_such_scene.json", "no_such_scene.json"),
    ],
)
def test_a_broken_scene_is_a_value_error_that_names_the_fault(farm, broken, said):
    with pytest.raises(ValueError, match=said):
        farm.render(broken, (32, 18), 1)


def test_wrong_arguments_are_told(farm):
    with pytest.raises(ValueError, match="samples"):
        farm.render(scene(), (32, 18), 0)
    with pytest.raises(ValueError, match="0"):
        farm.render(scene(), (0, 18), 1)
    with pytest.raises(TypeError, match="int"):
        farm.render(7, (32, 18), 1)
    with pytest.raises(OverflowError):
        farm.render(scene(), (32, 18), -1)
    with pytest.raises(ValueError, match="auto, cpu, gpu or none"):
        carom.Farm(backend="abacus")
    with pytest.raises(ValueError, match="missing.toml"):
        carom.Farm(config="missing.toml")
    with pytest.raises(ValueError, match="height times width times 3"):
        carom.srgb(np.zeros((4, 4)))


def test_wrong_meshes_are_told(farm):
    held = carom.Scene(scene())
    corner = np.zeros((3, 3))
    with pytest.raises(ValueError, match="n times 3"):
        held.add_mesh("flat", np.zeros((3, 2)), [[0, 1, 2]], "half")
    with pytest.raises(ValueError, match="position -1"):
        held.add_mesh("before", corner, [[0, 1, -1]], "half")
    with pytest.raises(ValueError, match="whole numbers"):
        held.add_mesh("parts", corner, [[0.5, 1, 2]], "half")
    with pytest.raises(ValueError, match="`gold`: there are half"):
        held.add_mesh("gold", corner, [[0, 1, 2]], "gold")
    held.add_mesh("beyond", corner, [[0, 1, 3]], "half")
    with pytest.raises(ValueError, match="beyond"):
        farm.render(held, (32, 18), 1)


def test_a_farm_without_nodes_and_a_closed_one_are_told():
    with pytest.raises(ValueError):
        carom.Farm(backend="none", nodes=["oak:1"], credentials="missing")
    farm = carom.Farm(backend="cpu")
    farm.close()
    with pytest.raises(carom.FarmError, match="closed"):
        farm.render(scene(), (32, 18), 1)
    assert farm.nodes() == []


def test_nodes_say_what_they_have_done(farm):
    farm.render(scene(), (64, 36), 1)
    [node] = farm.nodes()
    assert node["address"] == "local" and node["tiles"] > 0 and node["device"]


def test_progress_is_told_and_an_exception_in_it_cancels(farm):
    shares = []
    farm.render(POOL, (320, 180), 64, progress=shares.append)
    assert shares == sorted(shares) and all(0 <= share <= 1 for share in shares)

    class Enough(Exception):
        pass

    def stop(_):
        raise Enough

    with pytest.raises(Enough):
        farm.render(POOL, (1920, 1080), 4096, progress=stop)
    assert farm.render(scene(), (32, 18), 1).shape == (18, 32, 3)


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_an_interrupt_ends_a_long_render(farm):
    alarm = threading.Timer(0.3, signal.raise_signal, [signal.SIGINT])
    interrupt = signal.signal(signal.SIGINT, signal.default_int_handler)
    alarm.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            farm.render(POOL, (3840, 2160), 4096)
    finally:
        signal.signal(signal.SIGINT, interrupt)


def test_threads_render_side_by_side_and_python_goes_on(farm):
    alone = [farm.render(POOL, (96, 54), 8, seed=seed) for seed in range(3)]
    together = [None] * 3

    def work(seed):
        together[seed] = farm.render(POOL, (96, 54), 8, seed=seed)

    threads = [threading.Thread(target=work, args=(seed,)) for seed in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(a, b) for a, b in zip(alone, together))
