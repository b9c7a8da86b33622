"""Build entry for pip and colcon; pyproject.toml holds the metadata.

colcon reads ``python_requires`` and the version only from here.
"""

from setuptools import setup

setup(
    version="0.1.0",
    python_requires=">=3.10",
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/idim_iv_ros"]),
        ("share/idim_iv_ros", ["package.xml"]),
        ("lib/idim_iv_ros", ["scripts/recorder", "scripts/identifier", "scripts/robot_simulator"]),
    ],
)
