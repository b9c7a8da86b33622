"""Seconds of a request to the identifier beside the identification itself.

    python -m benchmarks.requests [OTHER_CHECKOUT]

With the path of another checkout the two are asked in turn, so that both meet the same machine.
Each is the node as it is run, on this machine only, with bags of 30 s of the arm with two joints.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from benchmarks.measurement import write_page

ROOT = Path(__file__).resolve().parents[1]
SECONDS, REQUESTS, IDLE = 30.0, 5, 15.0
# s; a wait that is longer ends the benchmark, with one line.
START_LIMIT, REQUEST_LIMIT, END_LIMIT = 120.0, 300.0, 30.0
DOMAIN = "98"


class Identifier:
    """One node, asked by its service; it ends with the stack."""

    def __init__(self, checkout: Path, folder: Path, name: str, stack: ExitStack) -> None:
        import rclpy

        from idim_iv_interfaces.srv import Identify

        self._rclpy, self._kind, self._checkout = rclpy, Identify, checkout
        given = {
            "configuration": checkout / "config" / "arm2.yaml",
            "bag_directory": folder,
            "output_directory": folder / name,
        }
        arguments = ["--ros-args", "-r", f"__node:={name}"]
        for key, value in given.items():
            arguments += ["-p", f"{key}:={value}"]
        begun = time.perf_counter()
        self.process = subprocess.Popen(
            [sys.executable, str(checkout / "scripts" / "identifier"), *arguments],
            env={**os.environ, "PYTHONPATH": str(checkout)},
            stderr=subprocess.DEVNULL,
        )
        stack.callback(self.end)
        self.node = rclpy.create_node(f"asking_{name}")
        self._client = self.node.create_client(Identify, f"/{name}/identify")
        if not self._client.wait_for_service(START_LIMIT):
            raise SystemExit(f"{checkout}: no service of the identifier within {START_LIMIT:g} s")
        self.start = time.perf_counter() - begun

    def ask(self) -> tuple[float, float]:
        """Seconds of a request, and those of its identification."""
        begun = time.perf_counter()
        future = self._client.call_async(self._kind.Request(bags=["bag.mcap"]))
        self._rclpy.spin_until_future_complete(self.node, future, timeout_sec=REQUEST_LIMIT)
        seconds, answer = time.perf_counter() - begun, future.result()
        if answer is None:
            raise SystemExit(f"{self._checkout}: no answer to a request within {REQUEST_LIMIT:g} s")
        if not answer.success:
            raise SystemExit(f"{self._checkout}: {answer.message}")
        return seconds, answer.result.duration

    def memory(self) -> float:
        """Memory of the node and its processes in MB, what they share counted once."""
        processes = [self.process.pid]
        for process in processes:
            children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
            processes += map(int, children)
        texts = [Path(f"/proc/{process}/smaps_rollup").read_text() for process in processes]
        lines = [next(li for li in text.splitlines() if li.startswith("Pss:")) for text in texts]
        return sum(int(line.split()[1]) for line in lines) / 1000.0

    def end(self) -> None:
        """Interrupt it, and kill it if it does not end."""
        self.process.terminate()
        try:
            self.process.wait(END_LIMIT)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait(END_LIMIT)


def main() -> None:
    """Ask all, and write the page."""
    os.environ.update(ROS_DOMAIN_ID=DOMAIN, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    import rclpy

    from idim_iv_ros import load_configuration
    from idim_iv_ros.excitation.excite import random_motion
    from idim_iv_ros.simulators.recording import simulate

    checkouts = {"this": ROOT, **({"before": Path(sys.argv[1])} if len(sys.argv) > 1 else {})}
    configuration = load_configuration(ROOT / "config" / "arm2.yaml")
    motion = random_motion(configuration, duration=SECONDS, rate=1000.0, seed=1)
    rclpy.init()
    with ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        simulate(configuration, folder / "bag.mcap", motion)
        nodes = {
            name: Identifier(checkout, folder, f"identifier_{name}", stack)
            for name, checkout in checkouts.items()
        }
        time.sleep(IDLE)
        asked = {name: [] for name in nodes}
        for _ in range(REQUESTS):
            for name, node in nodes.items():
                asked[name].append(node.ask())
        lines = [
            f"{REQUESTS} requests in turn, {IDLE:g} s after the start; a bag of {SECONDS:g} s, two "
            "joints, 1 kHz. Medians, and the largest.",
            "",
            "| | request, s | identification, s | beside it, s | start to service, s | idle, MB |",
            "|---|---|---|---|---|---|",
        ]
        for name, node in nodes.items():
            whole, identification = zip(*asked[name], strict=True)
            remainder = [a - b for a, b in asked[name]]
            lines.append(
                f"| {name} | {statistics.median(whole):.2f} | "
                f"{statistics.median(identification):.2f} | "
                f"{statistics.median(remainder):.2f}, {max(remainder):.2f} | {node.start:.1f} | "
                f"{node.memory():.0f} |"
            )
    lines += ["", f"Load of the machine meanwhile: {os.getloadavg()[0]:.1f}."]
    write_page("requests", "A request beside its identification", lines)


if __name__ == "__main__":
    main()
