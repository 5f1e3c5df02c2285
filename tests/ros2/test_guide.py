"""The guide's commands that need a ROS graph."""

import json
import os
import re
import subprocess

import yaml
from peer import FollowPath, path_of
from programs import REPOSITORY, SIDEHILL


def blocks(page, needs):
    """The commands of a page's blocks, a list of lines each."""
    with open(os.path.join(REPOSITORY, "docs", "guide", page)) as file:
        text = file.read()
    found = re.findall(r"^```sh *(\w*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    return [commands.splitlines() for needed, commands in found if needed == needs]


def test_the_guides_commands_for_ros_2_run(start, peer, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    init = blocks("first_run.md", "")[0][0].split()
    assert init[:2] == ["sidehill", "init"]
    subprocess.run([SIDEHILL, *init[1:]], check=True)
    programs = []
    for line in blocks("connect_ros2.md", "ros2")[0]:
        words = line.removesuffix("&").split()
        assert words[0] == "sidehill"
        programs.append(start(*words[1:]))
    vehicle, run = programs
    client = FollowPath(peer).wait()
    [[command]] = blocks("connect_ros2.md", "goal")
    poses = yaml.safe_load(re.search(r'"(\{.*\})"', command)[1])["path"]["poses"]
    places = [(pose["pose"]["position"]["x"], 0.0) for pose in poses]
    goal = client.send(path_of(places, poses[0]["header"]["frame_id"]))
    assert goal.reply.accepted
    assert goal.result(60).status == FollowPath.SUCCEEDED
    assert run.end() == 0, run.output()
    vehicle.end()
    replayed = subprocess.run(
        [SIDEHILL, "replay", "ros2.mcap", "--format", "json"], capture_output=True, text=True
    )
    assert json.loads(replayed.stdout)["different"] == 0, replayed.stdout + replayed.stderr
