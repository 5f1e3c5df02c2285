"""Drives figures of eight over ROS 2 for a while and watches memory and open files of both programs.

    python3 tests/ros2/soak.py [--minutes 10]

Prints a line every 15 s. The exit status is 0 where every goal succeeded and neither program's
resident memory grew by more than 512 KiB in the last quarter. Before that it may: the rings of the
record are 8192 rows long, whose pages are first written to in the first 410 s at 20 Hz.
"""

import argparse
import os
import pathlib
import random
import signal
import sys
import tempfile
import time

from peer import FollowPath, Peer, path_of
from programs import Program, adapted, figure_eight


def resident_kib(pid):
    with open(f"/proc/{pid}/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmRSS"))


def cpu_s(pid):
    with open(f"/proc/{pid}/stat") as file:
        fields = file.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=10.0)
    minutes = parser.parse_args().minutes
    domain = random.randint(1, 101)
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        programs = {
            name: Program([name, adapted(config, {}, folder)], domain, folder / f"{name}.log")
            for name, config in (("vehicle", "vehicle_ros2.yaml"), ("run", "run_ros2.yaml"))
        }
        action = FollowPath(Peer(domain)).wait()
        memory = {name: [] for name in programs}
        began, watched, ends = time.monotonic(), 0.0, []
        goal = number = None
        while time.monotonic() < began + 60 * minutes:
            if goal is None:
                goal = action.send(path_of(figure_eight()))
                assert goal.reply.accepted
                number = action.get_result.send(goal_id=goal.id)
            answer = action.get_result.reply(number)
            if answer is not None:
                ends.append(answer.status)
                goal = None
            # What has come is let go, so that only the programs' memory grows.
            for reader in (action.feedback, action.status):
                reader.take()
                reader.all.clear()
            if time.monotonic() - began >= watched:
                watched += 15.0
                for name, program in programs.items():
                    assert program.running(), program.output()
                    memory[name].append(resident_kib(program.process.pid))
                line = "  ".join(
                    f"{name} {memory[name][-1]} KiB, {len(os.listdir(f'/proc/{program.process.pid}/fd'))} files, "
                    f"{cpu_s(program.process.pid):.1f} s of CPU"
                    for name, program in programs.items()
                )
                print(f"{time.monotonic() - began:6.0f} s  {line}  {len(ends)} goals", flush=True)
            time.sleep(0.05)
        for program in programs.values():
            program.signal(signal.SIGINT)
            program.process.wait(timeout=10)
    failed = [status for status in ends if status != FollowPath.SUCCEEDED]
    grown = {}
    for name, samples in memory.items():
        grown[name] = samples[-1] - samples[-max(1, len(samples) // 4)]
    print(f"goals {len(ends)}, of them not succeeded {len(failed)}; grown in the last quarter by {grown} KiB")
    sys.exit(1 if failed or not ends or any(kib > 512 for kib in grown.values()) else 0)


if __name__ == "__main__":
    main()
