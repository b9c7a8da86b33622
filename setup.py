"""Build entry for pip and colcon; pyproject.toml holds the metadata.

colcon reads ``python_requires`` and the version only from here. The licence stands here because
setuptools 68, which a ROS 2 Jazzy installation brings, and 77 disagree on its form in pyproject.
"""

from pathlib import Path

from setuptools import setup


def files(*patterns: str) -> list[str]:
    """Files beside this one, as the names relative to it that `data_files` takes."""
    return sorted(path.as_posix() for pattern in patterns for path in Path().glob(pattern))


source = Path(__file__).resolve().parent
for name in ("pyproject.toml", "README.md"):
    # With --symlink-install colcon runs this file in a folder of links that lacks these two.
    if not Path(name).exists():
        Path(name).symlink_to(source / name)

setup(
    version="0.3.0",
    python_requires=">=3.10",
    license="Apache-2.0",
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/idim_iv_ros"]),
        ("share/idim_iv_ros", ["package.xml"]),
        ("share/idim_iv_ros/launch", files("launch/*.launch.py")),
        ("share/idim_iv_ros/config", files("config/*.yaml", "config/*.urdf")),
        ("share/idim_iv_ros/params", files("params/*.yaml")),
        ("share/idim_iv_ros/config/drivers", files("config/drivers/*.yaml")),
        ("share/idim_iv_ros/security", ["security/policy.xml"]),
        ("share/idim_iv_ros/layouts", files("layouts/*")),
        ("lib/idim_iv_ros", files("scripts/*")),
    ],
)
