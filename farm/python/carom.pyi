"""A path tracer over any mix of GPUs and CPUs, on this machine or on a farm: scenes in, NumPy arrays out.

Lengths are in metres, +z is up, radiance and albedo are linear with Rec. 709 primaries.
"""

from collections.abc import Callable, Sequence
from os import PathLike
from types import TracebackType
from typing import Any, Literal, TypedDict, final, overload, type_check_only

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Self

__all__ = ["Farm", "FarmError", "Scene", "__version__", "srgb"]

__version__: str

_SceneLike = Scene | dict[str, Any] | str | PathLike[str]

class FarmError(Exception):
    """A farm that cannot trace: no node answers, every node refuses, a device or the network failed.

    Wrong arguments, files and scenes raise `ValueError`, with the value and what it must be.
    """

@type_check_only
class Layers(TypedDict):
    """What a render with `layers=True` gives. Arrays are height times width times 3, depth height times width."""

    color: NDArray[np.float32]
    """Radiance."""
    albedo: NDArray[np.float32]
    """Reflectance of the surface first met, 0 to 1."""
    normal: NDArray[np.float32]
    """World-space normal on the camera's side; shorter where a pixel's normals differ."""
    depth: NDArray[np.float32]
    """Distance along the camera's axis in metres, infinite where nothing is met."""

@type_check_only
class NodeStatus(TypedDict):
    """A node of a farm."""

    address: str
    """`local`, or host and port."""
    state: str
    device: str | None
    """Absent until the node has answered."""
    msamples_per_sec: float
    """Million samples a second, as the balancer has learned it; 0 before the first frame."""
    tiles: int
    """Tiles that it has delivered."""

@final
class Scene:
    """A scene in memory, for several renders or for meshes of arrays."""

    def __new__(cls, source: _SceneLike) -> Self:
        """A scene from a dictionary in the format of scene files (`tracer/src/scene/file.rs`), in which NumPy arrays
        stand for lists, from the path of a file as `load` opens it, or from another scene, which is
        copied. Textures and environment maps of dictionaries are base64 (`{"encoded": ...}`).

        Raises ValueError if it breaks a rule of scenes, with the object and the value.
        """
    @staticmethod
    def load(
        path: str | PathLike[str],
        *,
        time: float | None = None,
        animation: str | int | None = None,
    ) -> Scene:
        """The scene of a file, by the ending of its name: `.json`, glTF 2.0 (`.gltf`, `.glb`), or a mesh (`.obj`, `.ply`) in
        grey under a sky and a lamp.

        time: seconds of a glTF file's animation. animation: its name or number; the first by default. Without either the
        file is as it is without its animations.

        Raises ValueError with the file, the place and the value if it cannot be drawn.
        """
    def save(self, path: str | PathLike[str]) -> None:
        """Writes a scene file."""
    def to_dict(self) -> dict[str, Any]:
        """The scene as a dictionary that `Scene` reads."""
    def look(
        self,
        eye: Sequence[float],
        target: Sequence[float],
        *,
        up: Sequence[float] = ...,
        fov_x_deg: float = 44.0,
    ) -> None:
        """Places the camera at `eye`, looking at `target`, upright along `up` (+z by default), with a horizontal field of view in (0, 180) degrees."""
    def add_mesh(
        self,
        name: str,
        positions: ArrayLike,
        triangles: ArrayLike,
        material: str,
        *,
        normals: ArrayLike | None = None,
        uvs: ArrayLike | None = None,
    ) -> None:
        """Adds n positions (n times 3) and m triangles (m times 3 indices), of a material that the scene has; shaded
        with a normal for each position if there are any, and textured by texture coordinates (n times 2)."""
    def add_mesh_file(self, name: str, path: str | PathLike[str], material: str) -> None:
        """Adds the mesh of an OBJ or PLY file."""

@final
class Farm:
    """Nodes that trace together: this machine's devices, and those of other machines.

    Threads may render on one farm side by side. As a context manager it is closed at the end.
    """

    def __new__(
        cls,
        nodes: Sequence[str] | None = None,
        *,
        backend: Literal["auto", "cpu", "gpu", "none"] | None = None,
        credentials: str | PathLike[str] | None = None,
        config: str | PathLike[str] | None = None,
        threads: int | None = None,
    ) -> Self:
        """A farm of `farm.toml` in the working folder, or of the file `config`, or else of this machine alone;
        arguments win over the file.

        nodes: other machines as `host:port`. backend: what this machine traces with. credentials: the folder with the
        player's certificate, which other machines ask for. threads: CPU threads, 0 is one a core.
        """
    @overload
    def render(
        self,
        scene: _SceneLike,
        size: tuple[int, int],
        spp: int,
        *,
        seed: int = 0,
        max_depth: int | None = None,
        denoise: bool = False,
        layers: Literal[False] = False,
        progress: Callable[[float], object] | None = None,
        time: float | None = None,
        animation: str | int | None = None,
    ) -> NDArray[np.float32]: ...
    @overload
    def render(
        self,
        scene: _SceneLike,
        size: tuple[int, int],
        spp: int,
        *,
        seed: int = 0,
        max_depth: int | None = None,
        denoise: bool = False,
        layers: Literal[True],
        progress: Callable[[float], object] | None = None,
        time: float | None = None,
        animation: str | int | None = None,
    ) -> Layers:
        """Radiance of `size` (width, height) with `spp` samples per pixel: float32, height times width times 3, row 0 at
        the top. The same arguments give the same bits on the same kind of device.

        max_depth: scattering events of a path at most. progress: called with the share that is done, 0 to 1; what it
        raises, Ctrl-C too, cancels the render. time, animation: of a scene's path, as in `Scene.load`.

        Raises ValueError for a scene or arguments that cannot be traced, FarmError if the farm cannot.
        """
    def nodes(self) -> list[NodeStatus]:
        """The farm's nodes, in the order in which they were added."""
    def close(self) -> None:
        """Ends the farm; renders that go on raise FarmError."""
    def __enter__(self) -> Farm: ...
    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

def srgb(image: ArrayLike, exposure: float = 1.0) -> NDArray[np.uint8]:
    """8-bit sRGB of radiance (height times width times 3) times `exposure`, through the tone curve of Khronos PBR
    Neutral."""
