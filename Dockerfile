# The suite in a container, for amd64 and arm64: `docker build -t binopos .`; then
#
#   docker run --rm --net host --ipc host --device /dev/video0 --device /dev/video2 \
#       -v /etc/binopos:/etc/binopos:ro binopos run --config /etc/binopos/rig.yaml
#
# `--net host --ipc host` lets other ROS nodes of the machine hear it, through shared memory too.
FROM ros:jazzy-ros-base AS build
RUN apt-get update && apt-get install -y --no-install-recommends \
        gcc libjpeg-turbo8-dev python3-dev python3-pip python3-setuptools python3-wheel \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /source
COPY setup.py setup.cfg pyproject.toml package.xml README.md ./
COPY resource ./resource
COPY config ./config
COPY bags ./bags
COPY binopos_ros ./binopos_ros
RUN python3 -m pip wheel --no-deps --no-build-isolation --wheel-dir /wheels .

FROM ros:jazzy-ros-base
RUN apt-get update && apt-get install -y --no-install-recommends \
        python3-numpy python3-opencv python3-pip python3-usb python3-yaml \
        ros-jazzy-common-interfaces ros-jazzy-tf2-msgs \
    && rm -rf /var/lib/apt/lists/*
COPY --from=build /wheels /wheels
# numpy and OpenCV are apt's; what apt does not have comes from the Python registry.
RUN python3 -m pip install --no-cache-dir --break-system-packages \
        mcap rosbags simplejpeg websockets \
    && python3 -m pip install --no-cache-dir --break-system-packages --no-deps \
        --no-index --find-links /wheels binopos_ros \
    && rm -rf /wheels
RUN useradd --create-home --groups video binopos
USER binopos
WORKDIR /home/binopos
ENV AMENT_PREFIX_PATH=/usr/local:/opt/ros/jazzy

# What BlueOS shows of an extension, and what it lets it have.
LABEL version="0.1.0"
LABEL type="device-integration"
LABEL tags='["navigation", "positioning", "interaction"]'
LABEL authors='[{"name": "binopos_ros maintainers", "email": "maintainers@example.com"}]'
LABEL permissions='{"HostConfig": {"NetworkMode": "host", "IpcMode": "host", "Binds": ["/dev:/dev", "/usr/blueos/extensions/binopos:/etc/binopos"], "DeviceCgroupRules": ["c 81:* rmw"]}}'

ENTRYPOINT ["/ros_entrypoint.sh", "binopos"]
CMD ["run", "--config", "/etc/binopos/rig.yaml"]
