"""What a user is told: paths of any kind work, and grips that hold nothing name fields that work."""

import re
import subprocess
import sys

import numpy as np
import pytest
from omegaconf import OmegaConf

from fracsim.mpm.grips import Grips
from fracsim.scene.program import compose
from fracsim.scene.quoting import quote, quoted

NAMES = ["a b.obj", "a=b.obj", "a[1].obj", "a(1).obj", "a{b}.obj", "a,b.obj", "l\u00f6we.obj", "\u718a.obj", "it's.obj",
         'a"b.obj', "a#1.obj", "a&b;c!.obj", "~a.obj", "null", "a%20b.obj", "a@b:c.obj", "a' b'.obj"]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("there", [True, False])
def test_a_path_of_any_letters_is_the_path(tmp_path, name, there):
    """Also of a file that is not there, but for commas: these are a sweep."""
    if there:
        (tmp_path / name).touch()
    path = str(tmp_path / name)
    if there or "," not in name:
        assert compose("asset=mesh", f"asset.path={path}").asset.path == path


def test_a_quoted_path_stays_as_it_is():
    assert quoted(["asset.path='a b.obj'", 'asset.path="a=b"']) == ["asset.path='a b.obj'", 'asset.path="a=b"']
    assert quoted(["asset.path=a/b-1.obj", "material.E=1e3,2e3", "-m"]) == [
        "asset.path=a/b-1.obj",
        "material.E=1e3,2e3",
        "-m",
    ]


def test_a_sweep_over_files_stays_a_sweep(tmp_path):
    for name in ("a(1).obj", "b.obj"):
        (tmp_path / name).touch()
    override = f"asset.path={tmp_path}/a(1).obj,{tmp_path}/b.obj"
    assert quoted([override]) == [f"asset.path='{tmp_path}/a(1).obj','{tmp_path}/b.obj'"]


@pytest.mark.parametrize("value", ["a'b", "a\\'b", "a\\", "'", "\\\\'\\", 'a"b'])
def test_quotes_are_read_back(value):
    from hydra.core.override_parser.overrides_parser import OverridesParser

    assert OverridesParser.create().parse_override(f"a={quote(value)}").value() == value


def test_the_command_line_takes_such_a_path(tmp_path):
    """`-c job` prints the configuration, without a simulation."""
    command = [sys.executable, "-m", "fracsim", "-c", "job", "asset=mesh", f"asset.path={tmp_path}/l\u00f6we (1)=2.obj"]
    shown = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=True, env=None)
    assert OmegaConf.create(shown.stdout).asset.path == f"{tmp_path}/l\u00f6we (1)=2.obj"


def refused(x, **fields):
    """The message about particles x (N, 3), at the distance of the default grips."""
    usual = {"axis": (1.0, 0.0, 0.0), "offset": 0.15, "thickness": 0.05}
    with pytest.raises(ValueError, match=r"loading\.offset=0\.15: the \w+ grip holds no particle") as error:
        Grips(mode="rigid", speed=1.0, h=0.01, **(usual | fields)).side(x)
    return str(error.value)


def box(*sides, n=4000):
    return np.random.default_rng(0).uniform(-0.5, 0.5, (n, 3)) * sides


def works(message, x, asked=0.0):
    """Whether each way that the message names holds particles at both ends."""
    ways = re.findall(r"with (loading\.[^.]+?=[\d.]+(?: loading\.\w+=[\d.]+)?)(?=\.$| or)", message)
    for way in ways:
        fields = {"axis_deg": 0.0, "offset": 0.15, "thickness": 0.05}
        fields["axis_deg"] = asked
        fields |= {f.partition("=")[0].removeprefix("loading."): float(f.partition("=")[2]) for f in way.split()}
        a = np.radians(fields.pop("axis_deg"))
        side = Grips(mode="rigid", axis=(np.cos(a), np.sin(a), 0.0), speed=1.0, h=0.01, **fields).side(x)
        assert {-1, 1} <= set(side.tolist())
        assert 2 * fields["offset"] > fields["thickness"]
    return ways


def test_an_upright_object_is_told_the_other_axis():
    x = box(0.1, 0.6, 0.1)
    assert [w.partition("=")[0] for w in works(refused(x), x)] == ["loading.offset", "loading.axis_deg"]
    assert "loading.axis_deg=90" in refused(x)


def test_an_object_along_the_diagonal_is_told_an_axis_that_works():
    x = box(0.6, 0.05, 0.05) @ np.array([[1, 1, 0], [-1, 1, 0], [0, 0, np.sqrt(2)]]) / np.sqrt(2)
    ways = works(refused(x, axis=(1 / np.sqrt(2), -1 / np.sqrt(2), 0.0)), x, asked=-45.0)
    assert any("axis_deg" in w for w in ways)


def test_a_small_object_is_told_smaller_grips():
    x = box(0.04, 0.04, 0.04)
    assert [w.count("=") for w in works(refused(x), x)] == [2]


def test_an_object_with_a_waist_is_told_an_offset_where_it_is():
    """Two balls at the ends of nothing: material lies between 0.2 and 0.3 m."""
    x = np.concatenate([box(0.1, 0.1, 0.1) + (side * 0.25, 0, 0) for side in (-1, 1)])
    ways = works(refused(x), x)
    assert any("offset" in way for way in ways)
