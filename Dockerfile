# The README's installation in ROS 2 Jazzy, for amd64 and arm64:
#   docker build -t idim_iv_ros .
#   docker run --rm -it -v "$PWD:/data" -w /data idim_iv_ros idim-iv identify run1.mcap --config my_arm.yaml --out results
FROM ros:jazzy-ros-base

RUN apt-get update \
    && apt-get install -y --no-install-recommends python3-venv \
    && rm -rf /var/lib/apt/lists/*

WORKDIR /ws
COPY . src/idim_iv_ros
RUN python3 -m venv --system-site-packages venv && touch venv/COLCON_IGNORE \
    && . venv/bin/activate \
    && pip install --no-cache-dir "numpy<2" "./src/idim_iv_ros[tables]" \
    && pip uninstall -y idim-iv-ros \
    && . /opt/ros/jazzy/setup.sh \
    && python -m colcon build \
    && rm -rf build log

# The workspace in every command, with the Python of the environment.
RUN printf '#!/bin/sh\n. /ws/venv/bin/activate\n. /ws/install/setup.sh\nexec "$@"\n' > /entrypoint \
    && chmod +x /entrypoint
ENTRYPOINT ["/entrypoint"]
CMD ["ros2", "launch", "idim_iv_ros", "demo.launch.py"]
