"""Formats of Gaussians beside the INRIA layout: written here by the formats' public descriptions, and read back.

Tolerances are half a step of each format's codes.
"""

import gzip
import struct

import numpy as np
import plyfile
import pyarrow
import pytest
from scipy.spatial.transform import Rotation

from fracsim.asset import gaussians, limits, splat, splat_file
from fracsim.scene.vocab import Asset

N, SPACING = 700, 0.02


@pytest.fixture
def cloud():
    """Means, deviations, rotations (w x y z, every component largest at times), opacities, colours, coefficients."""
    rng = np.random.default_rng(0)
    q = rng.normal(size=(N, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    return (rng.uniform(-1, 1, (N, 3)), np.exp(rng.uniform(-6, -3, (N, 3))), q, rng.uniform(0.1, 1, N),
            rng.uniform(0.1, 0.9, (N, 3)), rng.uniform(-0.9, 0.9, (N, 15, 3)))  # fmt: skip


def covariances(deviations, q):
    R = Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix()
    return np.einsum("nij,nj,nkj->nik", R, deviations**2, R)


def same(read, cloud, place, size, turn, alpha=0.5 / 255, colour=0.5 / 255):
    """Whether Gaussians are those of a cloud, within a step of position, logarithm of size, angle, opacity, colour."""
    means, deviations, q, opacity, rgb, _ = cloud
    assert np.allclose(read.means, means, atol=place)
    expected = covariances(deviations, q)
    error = np.linalg.norm(read.covariance - expected, axis=(1, 2)) / np.linalg.norm(expected, axis=(1, 2))
    # The covariance is quadratic in sizes; an angle mixes its axes to first order, twice.
    assert error.max() < 2.5 * (size + 2 * turn)
    assert np.allclose(read.opacity, opacity, atol=alpha + 1e-9)
    assert np.allclose(0.5 + gaussians.SH_C0 * read.sh[:, 0], rgb, atol=colour + 1e-9)


def spz_body(cloud, version, degree, bits=12):
    """The 16 bytes of the header of versions 1 to 3 and the attributes."""
    means, deviations, q, opacity, rgb, rest = cloud
    if version == 1:
        place = means.astype("<f2").tobytes()
    else:
        fixed = np.rint(means * (1 << bits)).astype("<i4")
        place = fixed.view(np.uint8).reshape(N, 3, 4)[..., :3].tobytes()
    f_dc = (rgb - 0.5) / gaussians.SH_C0
    q = q * np.where(q[:, :1] < 0, -1, 1) if version < 3 else q
    xyzw = q[:, [1, 2, 3, 0]]
    if version < 3:
        turn = np.rint((xyzw[:, :3] + 1) * 127.5).astype(np.uint8).tobytes()
    else:
        codes = []
        for row in xyzw:
            k = int(np.abs(row).argmax())
            code, row = k, row * np.sign(row[k])
            for i in range(4):
                if i != k:
                    code = code << 10 | (512 if row[i] < 0 else 0) | round(abs(row[i]) * 511 / np.sqrt(0.5))
            codes.append(code)
        turn = np.array(codes, "<u4").tobytes()
    k = {0: 0, 1: 3, 2: 8, 3: 15}[degree]
    parts = [place, np.rint(opacity * 255).astype(np.uint8).tobytes(),
             np.rint((f_dc * 0.15 + 0.5) * 255).astype(np.uint8).tobytes(),
             np.rint((np.log(deviations) + 10) * 16).astype(np.uint8).tobytes(), turn,
             np.rint(rest[:, :k] * 128 + 128).astype(np.uint8).tobytes()]  # fmt: skip
    return struct.pack("<4sIIBBBB", b"NGSP", version, N, degree, bits, 0, 0), parts


@pytest.mark.parametrize(("version", "degree"), [(1, 0), (2, 1), (2, 0), (3, 3), (3, 2), (4, 0), (4, 3)])
def test_spz(tmp_path, cloud, version, degree):
    """A colour step is 1 / 255 / 0.15 of f_dc; a size step 1/16; angles: 1/127.5, with w rebuilt, or 0.7 / 511."""
    head, parts = spz_body(cloud, version, degree)
    if version == 4:
        streams = [p for p in parts if p]
        packed = [pyarrow.Codec("zstd").compress(p, asbytes=True) for p in streams]
        head = head[:15] + bytes([len(streams)]) + struct.pack("<I", 40) + bytes(12) + b"ilv-data"
        table = b"".join(struct.pack("<QQ", len(c), len(p)) for c, p in zip(packed, streams, strict=True))
        content = head + table + b"".join(packed)
    else:
        content = gzip.compress(head + b"".join(parts))
    (tmp_path / "cloud.bin").write_bytes(content)
    assert splat_file.count(tmp_path / "cloud.bin") == N
    read = splat_file.read(tmp_path / "cloud.bin")
    turn = 0.09 if version < 3 else 0.003  # w rebuilt from x y z near a half turn loses the root of their error
    same(read, cloud, 1e-3, 1 / 32, turn, colour=0.5 / 255 / 0.15 * gaussians.SH_C0)
    k = (degree + 1) ** 2
    assert read.sh.shape == (N, k, 3)
    assert np.allclose(read.sh[:, 1:], cloud[5][:, : k - 1], atol=0.5 / 128 + 1e-9)


def test_splat(tmp_path, cloud):
    means, deviations, q, opacity, rgb, _ = cloud
    rows = np.zeros(N, [("m", "<f4", 3), ("s", "<f4", 3), ("c", "u1", 4), ("q", "u1", 4)])
    rows["m"], rows["s"] = means, deviations
    rows["c"] = np.rint(np.concatenate([rgb, opacity[:, None]], axis=1) * 255)
    rows["q"] = np.clip(np.rint(q * 128 + 128), 0, 255)
    rows.tofile(tmp_path / "cloud.splat")
    assert splat_file.count(tmp_path / "cloud.splat") == N
    same(splat_file.read(tmp_path / "cloud.splat"), cloud, 1e-6, 1e-6, 0.02)


def compressed(path, cloud, ranges=True, degree=0):
    """A compressed .ply as splat-transform writes it: `ranges` of colours are in the chunks of newer files."""
    means, deviations, q, opacity, rgb, rest = cloud
    chunks = -(-N // 256)
    values = {"": means, "scale_": np.log(deviations), "rgb": rgb}
    table, unit = {}, {}
    for name, value in values.items():
        unit[name] = value.copy()
        for k, axis in enumerate("rgb" if name == "rgb" else [f"{name}{a}" for a in "xyz"]):
            if name == "rgb" and not ranges:
                continue
            for end, f in (("min", np.min), ("max", np.max)):
                table[f"{end}_{axis}"] = [f(value[256 * c : 256 * c + 256, k]) for c in range(chunks)]
            lo, hi = (np.repeat(table[f"{end}_{axis}"], 256)[:N] for end in ("min", "max"))
            unit[name][:, k] = (value[:, k] - lo) / (hi - lo)

    def packed(fractions, widths):
        code = np.zeros(N, np.uint64)
        for fraction, width in zip(fractions.T, widths, strict=True):
            code = code << np.uint64(width) | np.rint(fraction * ((1 << width) - 1)).astype(np.uint64)
        return code.astype(np.uint32)

    largest = np.abs(q).argmax(axis=1)
    q = q * np.sign(q[np.arange(N), largest])[:, None]
    three = np.array([np.delete(row, k) for row, k in zip(q, largest, strict=True)]) * np.sqrt(0.5) + 0.5
    turn = packed(three, (10, 10, 10)) | (largest << 30).astype(np.uint32)
    vertex = np.zeros(N, [(f"packed_{n}", "<u4") for n in ("position", "rotation", "scale", "color")])
    vertex["packed_position"], vertex["packed_rotation"] = packed(unit[""], (11, 10, 11)), turn
    vertex["packed_scale"] = packed(unit["scale_"], (11, 10, 11))
    vertex["packed_color"] = packed(np.concatenate([unit["rgb"], opacity[:, None]], axis=1), (8, 8, 8, 8))
    chunk = np.array(list(zip(*table.values(), strict=True)), [(n, "<f4") for n in table])
    elements = [plyfile.PlyElement.describe(chunk, "chunk"), plyfile.PlyElement.describe(vertex, "vertex")]
    k = (degree + 1) ** 2 - 1
    if k:
        codes = np.clip(np.floor((rest[:, :k].transpose(0, 2, 1).reshape(N, -1) / 8 + 0.5) * 256), 0, 255)
        rows = np.array([tuple(r) for r in codes], [(f"f_rest_{i}", "u1") for i in range(3 * k)])
        elements.append(plyfile.PlyElement.describe(rows, "sh"))
    plyfile.PlyData(elements, byte_order="<").write(str(path))


@pytest.mark.parametrize(("ranges", "degree"), [(True, 0), (False, 0), (True, 1), (True, 3)])
def test_compressed_ply(tmp_path, cloud, ranges, degree):
    """Positions have steps of 2 / 1023, logarithms 3 / 1023, rotations 1 / 723, coefficients 1 / 32."""
    compressed(tmp_path / "cloud.compressed.ply", cloud, ranges, degree)
    assert splat_file.count(tmp_path / "cloud.compressed.ply") == N
    read = splat_file.read(tmp_path / "cloud.compressed.ply")
    same(read, cloud, 1.1e-3, 1.6e-3, 0.003)
    assert np.allclose(read.sh[:, 1:], cloud[5][:, : read.sh.shape[1] - 1], atol=0.5 / 32 + 1e-6)
    assert read.sh.shape[1] == (degree + 1) ** 2


def test_chunks_that_are_missing_are_named(tmp_path, cloud):
    compressed(tmp_path / "cloud.ply", cloud)
    file = plyfile.PlyData.read(tmp_path / "cloud.ply")
    short = plyfile.PlyElement.describe(file["chunk"].data[:1], "chunk")
    plyfile.PlyData([short, file["vertex"]], byte_order="<").write(str(tmp_path / "cut.ply"))
    with pytest.raises(ValueError, match=r"asset\.path=.*cut\.ply is a compressed \.ply without all of its chunks"):
        splat_file.read(tmp_path / "cut.ply")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("cloud.ksplat", b"\x00\x01" * 2048, "none of these"),
        ("cloud.sog", b"PK\x03\x04" + bytes(60), "zip archive"),
        ("meta.json", b'{"version": 2}', "JSON"),
        ("toy.bin", b"glTF" + bytes(60), "asset.kind=mesh"),
    ],
)
def test_other_formats_are_named_with_the_way_out(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=rf"asset\.path=.*{name} .*\.spz or \.splat.*{words}.*splat-transform {name}"):
        limits.check(Asset(kind="ply", path=str(tmp_path / name)), SPACING)


def test_a_later_version_of_spz_is_named(tmp_path):
    (tmp_path / "new.spz").write_bytes(gzip.compress(struct.pack("<4sIIBBBB", b"NGSP", 9, N, 0, 12, 0, 0)))
    with pytest.raises(ValueError, match=r"asset\.path=.*version 9 .*1 to 4.*splat-transform"):
        limits.check(Asset(kind="ply", path=str(tmp_path / "new.spz")), SPACING)


def test_a_cut_off_spz_is_refused(tmp_path, cloud):
    head, parts = spz_body(cloud, 3, 0)
    (tmp_path / "cut.spz").write_bytes(gzip.compress(head + b"".join(parts)[:-5]))
    with pytest.raises(ValueError, match=r"asset\.path=.*cut\.spz is a cut off"):
        splat_file.read(tmp_path / "cut.spz")
    (tmp_path / "cut.spz").write_bytes(gzip.compress(head + b"".join(parts))[:-900])
    with pytest.raises(ValueError, match=r"asset\.path=.*cut\.spz is a (cut off|damaged)"):
        splat_file.read(tmp_path / "cut.spz")


def test_a_splat_named_as_a_mesh_is_told_so(tmp_path):
    with pytest.raises(ValueError, match=r"asset\.path=.*it holds splats: set asset\.kind=ply"):
        limits.check(Asset(kind="mesh", path=str(tmp_path / "cloud.splat")), SPACING)


def test_a_splat_file_becomes_particles(tmp_path):
    """A red ball of discs in the format of viewers: whole, and red."""
    i = np.arange(4000) + 0.5
    y, turn = 1 - i / 2000, np.pi * (1 + 5**0.5) * i
    rows = np.zeros(4000, [("m", "<f4", 3), ("s", "<f4", 3), ("c", "u1", 4), ("q", "u1", 4)])
    rows["m"] = np.stack([np.sqrt(1 - y * y) * np.cos(turn), y, np.sqrt(1 - y * y) * np.sin(turn)], axis=1)
    rows["s"], rows["c"], rows["q"] = 0.03, (255, 0, 0, 255), (255, 128, 128, 128)
    rows.tofile(tmp_path / "ball.splat")
    particles = splat.prepare(Asset(kind="ply", path=str(tmp_path / "ball.splat")), SPACING, 0)
    assert particles.volume.sum() == pytest.approx(4 / 3 * np.pi * 0.3**3, rel=0.05)
    assert np.allclose(0.5 + gaussians.SH_C0 * particles.sh[:4000, 0], (1, 0, 0), atol=1e-6)
