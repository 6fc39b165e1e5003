"""A latent cache: what is written comes back bit for bit, is shared where it is equal, and is never half there."""

import json
import multiprocessing
import pickle
import re
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor

import fracgen.data
from fracgen.data import index, synthetic, writer
from fracgen.data.cache import LatentCache
from fracgen.data.writer import CacheWriter

ABOUT = {"vae": "a", "vae_dtype": "float32", "width": 32, "height": 32, "frames": 5, "frame_select": "head",
         "fps": 100.0, "streams": ["rgb", "damage"], "text": "t", "text_dim": 8, "image": "i", "dtype": "bfloat16",
         "normalisation": {"version": 1, "percentile": 99.5}}  # fmt: skip
SHAPE = (16, 2, 4, 4)


def drawn(seed: int, *shape: int) -> Tensor:
    return torch.randn(shape or SHAPE, generator=torch.Generator().manual_seed(seed))


def row(k: int, **more: Any) -> dict[str, Any]:
    return {"id": f"clip{k}", "split": "train", "object": "duck", "class": "high_stretch", "caption": "A duck.",
            "scalars": [0.25] * 6, "scales": {"damage": 1.0}, "E": 2e4, "nu": 0.45, "onset": 2.0, "crit": 3.0,
            "axis_deg": 30.0, "sha256": f"{k}", "force": f"f{k // 2}", "text": "t0", "image": "i0", **more}  # fmt: skip


def add(into: CacheWriter, k: int, **more: Any) -> None:
    """Clip number k: its latents are drawn from seed k, what it shares from others."""
    entry = row(k, **more)
    into.share("force", entry["force"], drawn(100 + k // 2))
    into.share("text", "t0", drawn(200, 3, 8))
    into.share("image", "i0", drawn(300, 257, 4))
    into.add(entry, {"rgb": drawn(k), "damage": drawn(k + 50)}, drawn(k)[:, 0])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Four clips, two a file: a clip has 2.5 KiB, the picture that all share 2 KiB, a force 1 KiB."""
    with CacheWriter(tmp_path / "latents", ABOUT, shard_mb=7.5e-3) as into:
        for k in range(4):
            add(into, k)
    return tmp_path / "latents"


def files(folder: Path, kind: str = "") -> list[str]:
    return sorted(p.name for p in folder.glob(f"{kind}*.safetensors"))


def test_a_clip_comes_back_bit_for_bit(folder: Path) -> None:
    cache = fracgen.data.open(folder)
    assert len(cache) == 4
    for k, clip in enumerate(cache[k] for k in range(4)):
        assert clip.ids == [f"clip{k}"]
        assert list(clip.latents) == ["rgb", "damage"]
        assert torch.equal(clip.latents["rgb"], drawn(k).bfloat16())
        assert torch.equal(clip.latents["damage"], drawn(k + 50).bfloat16())
        assert torch.equal(clip.reference, drawn(k)[:, 0].bfloat16())
        assert torch.equal(clip.force, drawn(100 + k // 2).bfloat16())
        assert clip.image is not None
        assert torch.equal(clip.image, drawn(300, 257, 4).bfloat16())
        assert torch.equal(clip.scalars, torch.full((6,), 0.25))
        assert (clip.indices, clip.epoch, clip.slot) == (k, 0, 0)


def test_the_caption_is_followed_by_zeros(folder: Path) -> None:
    text = fracgen.data.open(folder)[0].text
    assert text.shape == (512, 8)
    assert torch.equal(text[:3], drawn(200, 3, 8).bfloat16())
    assert not text[3:].any()


def test_clips_become_a_batch(folder: Path) -> None:
    cache = fracgen.data.open(folder)
    batch = fracgen.data.collate([cache[2], cache[fracgen.data.Place(1, 7, 3)]])
    assert batch.ids == ["clip2", "clip1"]
    assert (batch.indices.tolist(), batch.epoch.tolist(), batch.slot.tolist()) == ([2, 1], [0, 7], [0, 3])
    assert batch.latents["damage"].shape == (2, *SHAPE)
    assert batch.image is not None
    assert [list(t.shape) for t in (batch.force, batch.scalars, batch.reference, batch.text, batch.image)] == [
        [2, *SHAPE], [2, 6], [2, 16, 4, 4], [2, 512, 8], [2, 257, 4]]  # fmt: skip
    plain = cache.only(["rgb"], image=False)
    assert fracgen.data.collate([plain[0]]).image is None


def test_only_what_is_asked_for_is_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read, keys = LatentCache._read, []

    def noted(self: LatentCache, name: str, key: str) -> Tensor:
        keys.append(key)
        return read(self, name, key)

    monkeypatch.setattr(LatentCache, "_read", noted)
    assert list(fracgen.data.open(folder).only(["rgb"], image=False)[1].latents) == ["rgb"]
    assert sorted(keys) == ["clip1.reference", "clip1.rgb", "f0", "t0"]


def test_a_stream_that_the_cache_lacks_is_named(folder: Path) -> None:
    with pytest.raises(ValueError, match=r"lacks flow, stress; it has rgb, damage: encode with streams=\[rgb,flow,str"):
        fracgen.data.open(folder).only(["stress", "flow", "rgb"])


def test_what_is_equal_is_stored_once(folder: Path) -> None:
    keys = [key for name in files(folder) for key in load_file(folder / name)]
    assert len(keys) == len(set(keys))
    assert [sum(key.startswith(kind) for key in keys) for kind in ("f", "t", "i", "clip")] == [2, 1, 1, 12]


def test_a_file_is_closed_at_its_size_and_another_follows(folder: Path) -> None:
    assert files(folder, "shard") == ["shard-00000.safetensors", "shard-00001.safetensors"]
    with CacheWriter(folder, ABOUT) as into:
        add(into, 4)
    assert files(folder, "shard")[-1] == "shard-00002.safetensors"
    assert [fracgen.data.open(folder)[k].ids for k in (0, 4)] == [["clip0"], ["clip4"]]


def test_a_file_is_closed_when_it_is_old(tmp_path: Path) -> None:
    with CacheWriter(tmp_path, ABOUT, minutes=1e-9) as into:
        for k in range(2):
            add(into, k)
    assert len(files(tmp_path, "shard")) == 2


def test_others_may_read_what_the_folder_lets_them(folder: Path) -> None:
    assert len({path.stat().st_mode for path in folder.iterdir()}) == 1


def first(cache: LatentCache) -> Tensor:
    return cache[3].latents["rgb"].clone()


def test_a_cache_travels_to_other_processes(folder: Path) -> None:
    cache = fracgen.data.open(folder)
    here = first(cache)  # opens files, which must stay behind
    assert torch.equal(first(pickle.loads(pickle.dumps(cache))), here)
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert torch.equal(pool.apply(first, (cache,)), here)


def test_files_are_opened_again_when_there_are_many(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fracgen.data.cache.OPEN", 1)
    cache = fracgen.data.open(folder)
    assert [cache[k].ids[0] for k in (0, 3, 1, 2)] == ["clip0", "clip3", "clip1", "clip2"]
    assert len(cache._open) == 1


@pytest.mark.parametrize("name", index.FIELDS)
def test_a_cache_made_otherwise_is_refused_by_name(folder: Path, name: str) -> None:
    told = rf"{re.escape(f'{name}={ABOUT[name]}')}, but {name}=other is asked for: choose another output\.folder"
    with pytest.raises(ValueError, match=told):
        CacheWriter(folder, {**ABOUT, name: "other"})


def test_a_folder_that_is_no_cache_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"is no latent cache: .* python -m fracgen\.encode data=FOLDER"):
        fracgen.data.open(tmp_path)
    (tmp_path / index.ABOUT).write_text("{")
    with pytest.raises(ValueError, match=r"cache\.json cannot be read .* encode into another folder"):
        fracgen.data.open(tmp_path)
    (tmp_path / index.ABOUT).write_text(json.dumps({**ABOUT, "version": 99}))
    with pytest.raises(ValueError, match="version 99, but this fracgen reads version 1"):
        fracgen.data.open(tmp_path)


def test_a_damaged_index_is_refused(folder: Path) -> None:
    (folder / index.INDEX).write_bytes(b"PAR1")
    with pytest.raises(ValueError, match=r"index\.parquet cannot be read .*: remove it and encode again"):
        fracgen.data.open(folder)


def test_a_lost_file_is_named_and_its_clips_keep_their_numbers(folder: Path) -> None:
    (folder / "shard-00000.safetensors").unlink()
    with pytest.raises(ValueError, match=r"shard-00000\.safetensors is missing\. Repeat the python -m fracgen"):
        fracgen.data.open(folder)
    with CacheWriter(folder, ABOUT) as into:
        assert into.dropped == {"shard-00000.safetensors": "is missing"}
        assert [into.has(f"clip{k}", f"{k}") for k in range(4)] == [False, False, True, True]
        add(into, 1)
    cache = fracgen.data.open(folder)
    assert cache.numbers() == [1, 2, 3]  # clip 0 still waits
    assert torch.equal(cache[1].latents["rgb"], drawn(1).bfloat16())


def test_a_lost_file_that_clips_share_is_made_again_with_them(folder: Path) -> None:
    path = folder / "text-00000.safetensors"
    path.write_bytes(path.read_bytes()[:-1])
    with CacheWriter(folder, ABOUT) as into:
        assert "bytes instead of" in into.dropped[path.name]
        assert not into.has("clip3", "3")
        assert not into.shares("text", "t0")
        for k in range(4):
            add(into, k)
    assert fracgen.data.open(folder).numbers() == [0, 1, 2, 3]


def test_a_changed_byte_is_found_by_its_hash(folder: Path) -> None:
    path = folder / "force-00000.safetensors"
    path.write_bytes(path.read_bytes()[:-1] + b"\0")
    found = index.load(folder)
    assert index.lacking(found, folder) == {}
    assert index.lacking(found, folder, hashes=True) == {path.name: "has changed: its sha256 is another one"}


def test_a_clip_of_a_changed_sample_replaces_the_old_one(folder: Path) -> None:
    with CacheWriter(folder, ABOUT) as into:
        assert not into.has("clip1", "new")
        add(into, 1, sha256="new")
        into._pending["shard"]["clip1.rgb"] = drawn(77).bfloat16()
    cache = fracgen.data.open(folder)
    assert len(cache) == 4
    assert torch.equal(cache[1].latents["rgb"], drawn(77).bfloat16())


def test_a_kill_before_the_index_is_replaced_leaves_the_old_cache(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(*_: Any) -> None:
        raise OSError("killed")

    with monkeypatch.context() as patch:
        patch.setattr(index, "save", killed)
        into = CacheWriter(folder, ABOUT)
        add(into, 4)
        with pytest.raises(OSError, match="killed"):
            into.flush()
    into._lock.close()
    assert len(fracgen.data.open(folder)) == 4
    with CacheWriter(folder, ABOUT) as into:  # its file takes the place of the one that no index lists
        add(into, 5)
    assert fracgen.data.open(folder)[4].ids == ["clip5"]
    assert len(files(folder, "shard")) == 3


def test_clips_that_are_done_are_kept_after_an_interruption(tmp_path: Path) -> None:
    with suppress(KeyboardInterrupt), CacheWriter(tmp_path, ABOUT) as into:
        add(into, 0)
        raise KeyboardInterrupt
    assert len(fracgen.data.open(tmp_path)) == 1


def test_a_full_disk_is_named_and_leaves_no_half_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: dict[str, Tensor], path: Path) -> None:
        path.write_bytes(b"half")
        raise SafetensorError("No space left on device")

    before = files(folder)
    monkeypatch.setattr(writer, "save_file", full)
    into = CacheWriter(folder, ABOUT)
    add(into, 4, force="new")
    with pytest.raises(OSError, match=r"-0000\d\.safetensors cannot be written .*No space left"):
        into.flush()
    assert files(folder) == before
    assert [path.name for path in folder.glob(".*")] == [index.LOCK]


def test_two_processes_do_not_write_at_once(folder: Path) -> None:
    with CacheWriter(folder, ABOUT):
        with pytest.raises(ValueError, match="is being written by another process: wait until it has ended"):
            CacheWriter(folder, ABOUT)
        assert len(fracgen.data.open(folder)) == 4
    with CacheWriter(folder, ABOUT):
        pass


def test_clips_are_chosen_by_split_and_object(tmp_path: Path) -> None:
    cache = fracgen.data.open(synthetic.write(tmp_path, clips=6))
    assert cache.numbers() == [0, 1, 2, 3, 4, 5]
    assert cache.numbers("all") == [0, 1, 2, 3, 4, 5]
    assert cache.numbers("train") == [0, 1, 4, 5]
    assert cache.numbers("train", ["duck", "star"]) == [1, 5]
    assert cache.numbers(objects=["whale"]) == []
    assert "6 clips of 9 frames, 32 x 32 px" in repr(cache)
