"""Recorded and simulated robots side by side, as a video or an animated picture."""

import os
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from idim_iv_ros.errors import UsageError, one_line
from idim_iv_ros.files import VIDEOS, FilePath, complete_files, require_file_place
from idim_iv_ros.model import RobotModel
from idim_iv_ros.model.mujoco_package import load_mujoco
from idim_iv_ros.model.skeleton import Skeleton, skeleton
from idim_iv_ros.simulators.replay_result import CORRECTED, NOMINAL, WITH_EFFECTS, ReplayResult
from idim_iv_ros.types import FloatArray

_WIDTH, _HEIGHT = 720, 320
_FIELD = 15.0  # degrees: a narrow one shows all robots from the same side
_FRAMES = {".mp4": 30.0, ".gif": 12.5}  # 1/s
_LONGEST = 12.0  # s of the recording, which are shown
_COLOURS = {
    "recorded": (0.25, 0.25, 0.27, 1.0),
    NOMINAL: (0.6, 0.6, 0.62, 1.0),
    CORRECTED: (0.34, 0.7, 0.91, 1.0),
    WITH_EFFECTS: (0.0, 0.45, 0.7, 1.0),
}


def require_video(path: FilePath | None, *, force: bool = False) -> None:
    """Make sure, before long work, that a video of that name can be made here.

    Raises
    ------
    UsageError
        Another suffix, no library for it, nothing that draws, or as `require_file_place`.
    """
    if path is None:
        return
    suffix = Path(path).suffix.lower()
    if suffix not in VIDEOS:
        raise UsageError(f"--video {path}: give a name that ends in .mp4 or .gif")
    require_file_place([Path(path)], force=force)
    if "MUJOCO_GL" not in os.environ and not os.environ.get("DISPLAY"):
        os.environ["MUJOCO_GL"] = "egl"  # draws without a screen
    mujoco = load_mujoco(f"--video {path}")
    try:
        import_module("imageio")
        if suffix == ".mp4":
            import_module("imageio_ffmpeg")
    except ImportError as error:
        other = "; a .gif needs nothing more" if suffix == ".mp4" else ""
        package = "imageio-ffmpeg" if suffix == ".mp4" else "imageio"
        raise UsageError(f"--video {path} needs {package}: pip install {package}{other}") from error
    try:
        model = mujoco.MjModel.from_xml_string("<mujoco/>")
        renderer = mujoco.Renderer(model, 16, 16)
        renderer.update_scene(mujoco.MjData(model))
        renderer.render()
        renderer.close()
    except Exception as error:  # whatever the drivers say
        raise UsageError(
            f"--video {path}: nothing draws here ({one_line(error)}); set MUJOCO_GL to egl or "
            "osmesa where their libraries are installed, or leave --video out"
        ) from error


def write_video(result: ReplayResult, robot: RobotModel, path: FilePath) -> None:
    """Write the motion of the first recording, recorded robot and every stage side by side."""
    mujoco = load_mujoco(f"--video {path}")
    imageio = import_module("imageio")
    target = Path(path)
    rate = _FRAMES[target.suffix.lower()]
    frames = _frames(mujoco, result, robot, rate)
    options: dict[str, Any] = {"fps": rate}
    if target.suffix.lower() == ".gif":
        options = {"duration": 1000.0 / rate, "loop": 0}
    try:
        with complete_files([target]) as temporary:
            imageio.mimwrite(temporary[target], frames, **options)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from error


def _frames(mujoco: Any, result: ReplayResult, robot: RobotModel, rate: float) -> list[Any]:
    """Pictures (height, width, 3) of the whole recording, or of its beginning."""
    names = list(result.positions)
    lines = skeleton(robot).segments
    reach = max(0.1, float(sum(np.linalg.norm(end - start) for start, end in lines)))
    hangs = min(float(end[2]) for _, end in lines) < -0.05
    spacing = 1.1 * reach
    spec = mujoco.MjSpec()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = _WIDTH, _HEIGHT
    spec.visual.headlight.ambient = [0.6, 0.6, 0.6]
    spec.visual.global_.fovy = _FIELD
    sky = spec.add_texture(type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, width=32, height=192)
    sky.builtin = mujoco.mjtBuiltin.mjBUILTIN_FLAT
    sky.rgb1 = sky.rgb2 = [1.0, 1.0, 1.0]
    floor = spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[20.0, 20.0, 0.1], rgba=[0.96, 0.96, 0.97, 1.0]
    )
    floor.pos = [0.0, 0.0, -reach if hangs else 0.0]
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = (0.0, 0.0, 0.0 if hangs else 0.4 * reach)
    height = max(len(names) * spacing * _HEIGHT / _WIDTH, 1.3 * reach)
    camera.distance = 0.5 * height / np.tan(np.radians(0.5 * _FIELD))
    # From half way between the axes of the base: arms often move in the plane of one of them.
    camera.azimuth, camera.elevation = 135.0, -12.0
    step = max(1, round(result.rate / rate))
    chosen = range(0, len(result.positions[names[0]]), step)[: round(_LONGEST * rate)]
    pictures = []
    renderer = mujoco.Renderer(model, _HEIGHT, _WIDTH)
    try:
        for sample in chosen:
            renderer.update_scene(data, camera)
            for place, name in enumerate(names):
                across = (place - 0.5 * (len(names) - 1)) * spacing * np.sqrt(0.5)
                drawn = skeleton(robot, result.positions[name][sample])
                base = np.array([across, across, 0.0])
                _draw(mujoco, renderer.scene, drawn, base, _COLOURS[name], 0.04 * reach)
            pictures.append(_labelled(renderer.render(), names))
    finally:
        renderer.close()
    return pictures


def _draw(
    mujoco: Any,
    scene: Any,
    drawn: Skeleton,
    base: FloatArray,
    colour: tuple[float, ...],
    radius: float,
) -> None:
    """Links as capsules, and joints as cylinders along their axes."""
    kinds = mujoco.mjtGeom
    parts = [(kinds.mjGEOM_CAPSULE, 0.7 * radius, *line) for line in drawn.segments]
    for origin, axis in zip(drawn.origins, 1.3 * radius * drawn.axes, strict=True):
        parts.append((kinds.mjGEOM_CYLINDER, radius, origin - axis, origin + axis))
    for kind, size, start, end in parts:
        if np.linalg.norm(end - start) > 1e-6 and scene.ngeom < scene.maxgeom:
            geom = scene.geoms[scene.ngeom]
            mujoco.mjv_initGeom(
                geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), np.array(colour, "f4")
            )
            mujoco.mjv_connector(geom, kind, size, base + start, base + end)
            scene.ngeom += 1


def _labelled(picture: Any, names: list[str]) -> Any:
    """Names of the robots above them, from the left."""
    drawing, image = import_module("PIL.ImageDraw"), import_module("PIL.Image")
    canvas = image.fromarray(picture)
    pen = drawing.Draw(canvas)
    for place, name in enumerate(names):
        middle = (place + 0.5) * _WIDTH / len(names)
        pen.text((middle, 14), name, fill=(30, 30, 32), anchor="mm")
    return np.asarray(canvas)
