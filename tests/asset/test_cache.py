"""Prepared objects: found again by what they follow from, made again when they are broken."""

import json
import os
from dataclasses import fields

import numpy as np
import pytest
import trimesh

from fracsim.asset import builtin, cache, mesh
from fracsim.asset.build import build
from fracsim.records import Particles
from fracsim.scene.vocab import Asset

SPACING = 1 / 40


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("FRACSIM_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def ball(tmp_path):
    path = tmp_path / "ball.ply"
    trimesh.creation.icosphere(1).export(path)
    return path


def forbidden(*_):
    raise AssertionError("made again")


def test_an_object_is_made_once(monkeypatch, folder):
    first = build(Asset(name="bar"), SPACING, 0)
    monkeypatch.setattr(builtin, "prepare", forbidden)
    again = build(Asset(name="bar"), SPACING, 0)
    for f in fields(Particles):
        a, b = getattr(first, f.name), getattr(again, f.name)
        assert np.array_equal(a, b)
        assert type(a) is type(b)
        assert not isinstance(a, np.ndarray) or a.dtype == b.dtype
    assert [p.suffix for p in folder.iterdir()] == [".npz"]


def test_notes_are_kept(ball, monkeypatch):
    first = build(Asset(kind="mesh", path=str(ball)), SPACING, 0)
    monkeypatch.setattr(mesh, "prepare", forbidden)
    assert first.notes
    assert build(Asset(kind="mesh", path=str(ball)), SPACING, 0).notes == first.notes


def test_the_key_follows_what_matters_and_nothing_else(ball):
    def key(spacing=SPACING, seed=0, **fields):
        return cache.key(Asset(**({"kind": "mesh", "path": str(ball)} | fields)), spacing, seed)

    assert key() == key(opacity_threshold=0.5, max_particles=7, name="bear")
    others = [key(size=0.5), key(rotate_deg=[0.0, 0.0, 1.0]), key(interior="#ff0000"), key(spacing=0.02), key(seed=1)]
    assert len({key(), *others}) == 6
    built_in = {"kind": "builtin", "path": ""}
    assert key(**built_in) != key(**built_in, name="bear")
    assert key(**built_in, seed=0) != key(**built_in, seed=1)


def test_the_key_follows_the_contents_of_the_file(ball, tmp_path):
    before = cache.key(Asset(kind="mesh", path=str(ball)), SPACING, 0)
    copy = tmp_path / "copy.ply"
    copy.write_bytes(ball.read_bytes())
    assert cache.key(Asset(kind="mesh", path=str(copy)), SPACING, 0) == before
    trimesh.creation.icosphere(2).export(ball)
    assert cache.key(Asset(kind="mesh", path=str(ball)), SPACING, 0) != before


def test_the_key_follows_textures_and_buffers(tmp_path):
    (tmp_path / "a.obj").write_text("mtllib a b.mtl\nv 0 0 0\n")
    (tmp_path / "a b.mtl").write_text("newmtl m\nmap_Kd -s 1 1 1 skin.png\n")
    (tmp_path / "skin.png").write_bytes(b"one")
    document = {"buffers": [{"uri": "data%20file.bin"}], "images": [{"uri": "data:image/png;base64,AA=="}]}
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    (tmp_path / "data file.bin").write_bytes(b"one")
    for name, part in (("a.obj", "skin.png"), ("a.obj", "a b.mtl"), ("a.gltf", "data file.bin")):
        asset = Asset(kind="mesh", path=str(tmp_path / name))
        before = cache.key(asset, SPACING, 0)
        (tmp_path / part).write_bytes((tmp_path / part).read_bytes() + b"\nmore")
        assert cache.key(asset, SPACING, 0) != before, part


@pytest.mark.parametrize("harm", [b"", b"not a zip", None])
def test_a_broken_file_is_made_again(folder, harm):
    first = build(Asset(name="bar"), SPACING, 0)
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2] if harm is None else harm)
    assert np.array_equal(build(Asset(name="bar"), SPACING, 0).X, first.X)
    assert file.stat().st_size == len(whole)


def test_a_changed_byte_is_noticed(folder):
    """The zip archive carries checksums."""
    first = build(Asset(name="bar"), SPACING, 0)
    (file,) = folder.iterdir()
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 255
    file.write_bytes(content)
    assert np.array_equal(build(Asset(name="bar"), SPACING, 0).sh, first.sh)


def test_a_folder_that_cannot_be_written_is_only_a_warning(folder):
    folder.write_text("a file, where a folder is needed")
    with pytest.warns(UserWarning, match="FRACSIM_CACHE"):
        assert len(build(Asset(name="bar"), SPACING, 0)) > 8


def test_the_default_folder(monkeypatch, tmp_path):
    monkeypatch.delenv("FRACSIM_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache.folder() == tmp_path / "fracsim"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache.folder().parts[-2:] == (".cache", "fracsim")
    assert os.environ.get("FRACSIM_CACHE") is None
