"""The good input, and the process that runs the commands."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from tests.command_line import CommandLine
from tests.fuzz.case import Good, command, simulation


@pytest.fixture(scope="session")
def fuzzed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[CommandLine, Good]]:
    """`idim-iv` with everything loaded, and the good input."""
    folder = tmp_path_factory.mktemp("good")
    line = CommandLine(tmp_path_factory.mktemp("logs"), columns=200)
    try:
        arguments = simulation(folder)
        arguments[-1] = "4"
        assert line.warm_up(arguments) == 0
        bag = folder / "s.mcap"
        for name in ("check", "identify", "diagnose"):
            arguments = command(name, folder, [bag])
            arguments = [a.replace("/out", f"/{name}") for a in arguments]
            assert line.warm_up(arguments) == 0, name
        yield line, _good(bag)
    finally:
        line.close()


def _good(bag: Path) -> Good:
    stamps, states, references = [], [], []
    with AnyReader([bag], default_typestore=None) as reader:
        for connection, _, raw in reader.messages():
            if connection.topic == "/robot_description":
                continue
            message = reader.deserialize(raw, connection.msgtype)
            stamp = message.header.stamp
            if connection.topic == "/joint_states":
                stamps.append(stamp.sec + 1e-9 * stamp.nanosec)
                states.append((message.position, message.effort))
            else:
                references.append(message.position)
    return Good(
        bag,
        np.array(stamps),
        np.array([position for position, _ in states]),
        np.array([effort for _, effort in states]),
        np.array(references),
    )
