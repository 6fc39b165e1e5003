"""LPIPS with random weights of the right shapes: against plain NumPy, and against torchmetrics with that network."""

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn
from torchmetrics.functional.image import lpips as theirs

from fracgen.evaluation import backbones, perceptual
from fracgen.evaluation.weights import MissingWeightsError
from fracgen.metrics import lpips
from tests.metrics import naive_networks
from tests.metrics.naive_networks import distance
from tests.metrics.pixel_clips import noise, pair

PLANS = {"alex": naive_networks.ALEX, "vgg": naive_networks.VGG}
ROUNDING = 1e-4
"""Relative; float32 of up to 13 layers, each of some 1e-6, in squares of differences of unit vectors."""
EPSILON = 2e-3
"""Relative; torchmetrics adds 1e-8 to the square of a length, so that features of length 1e-3 become 0.5 % shorter."""


def random_weights(net: str) -> dict[str, Tensor]:
    """Weights under torchvision's names that keep the size of features, the classifier's among them."""
    torch.manual_seed(0)
    out: dict[str, Tensor] = {"classifier.1.weight": torch.zeros(2, 2)}
    for name, layer in lpips.NETS[net][0]().layers.named_children():
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
            out |= {f"features.{name}.{part}": value.detach() for part, value in layer.named_parameters()}
    return out


@pytest.fixture(scope="module", params=["alex", "vgg"])
def net(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def file(net: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("weights") / f"{net}.pth"
    torch.save(random_weights(net), path, _use_new_zipfile_serialization=False)  # as files of before 2020 are
    return path


@pytest.fixture(scope="module")
def metric(net: str, file: Path) -> lpips.Lpips:
    return lpips.build(lpips.Settings(net=net, weights=str(file), batch=2))


def test_it_is_the_published_formula(net: str, file: Path, metric: lpips.Lpips) -> None:
    """With the heads that torchmetrics ships; three frames in batches of two."""
    convolutions = {name.removeprefix("features."): value.numpy() for name, value in random_weights(net).items()}
    shipped = torch.load(lpips.HEADS / f"{net}.pth", map_location="cpu", weights_only=True)
    heads = [shipped[f"lin{k}.model.1.weight"].flatten().double().numpy() for k in range(5)]
    a, b = noise(0, size=40), noise(1, size=40)
    wanted = [distance(PLANS[net], convolutions, heads, np.stack(frames)) for frames in zip(a, b, strict=True)]
    assert metric.scores(a, b) == pytest.approx(wanted, rel=ROUNDING)
    assert metric.observe(pair(a, b))["lpips_gen"] == pytest.approx(np.mean(wanted[1:]), rel=ROUNDING)


def test_it_is_that_of_torchmetrics(net: str, metric: lpips.Lpips, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their network is given these layers in place of torchvision's."""
    monkeypatch.setattr(theirs, "_get_tv_model_features", lambda *_, **__: metric.network.net)
    reference = theirs._LPIPS(net=net)  # type: ignore[arg-type]
    a, b = noise(0, frames=2, size=64), noise(1, frames=2, size=64)
    tensors = [torch.from_numpy(video).permute(0, 3, 1, 2).float() / 255 for video in (a, b)]
    with torch.no_grad():
        wanted = reference(*tensors, normalize=True).flatten()
    assert metric.scores(a, b) == pytest.approx(wanted.numpy(), rel=EPSILON)


def test_equal_clips_have_no_distance_and_order_does_not_matter(metric: lpips.Lpips) -> None:
    a, b = noise(0), noise(1)
    assert metric.observe(pair(a, a)) == {"lpips": 0, "lpips_gen": 0}
    assert metric.scores(a, b) == pytest.approx(metric.scores(b, a), rel=1e-6)
    assert metric.scores(a, b).min() > 0


def test_it_says_that_the_weights_are_not_the_published_ones(net: str, metric: lpips.Lpips) -> None:
    assert metric.about()["network"].startswith("not the published")
    assert len(metric.about()["sha256"]) == 64


def test_published_weights_are_known_by_their_hash(net: str, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    digits = {"alex": "7be5be79", "vgg": "397923af"}[net]
    monkeypatch.setattr(lpips, "sha256", lambda _: digits + "0" * 56)
    about = lpips.build(lpips.Settings(net=net, weights=str(file))).about()
    assert about["network"] == {"alex": "AlexNet of ImageNet", "vgg": "VGG16 of ImageNet"}[net]


def test_layers_have_the_shapes_of_the_published_networks() -> None:
    """Weights of the features: AlexNet 2,469,696, VGG16 14,714,688."""
    counts = [sum(p.numel() for p in build().layers.parameters()) for build in (backbones.alexnet, backbones.vgg16)]
    assert counts == [2_469_696, 14_714_688]


def test_missing_weights_are_named_with_size_and_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TORCH_HOME", str(tmp_path))
    monkeypatch.delenv("FRACGEN_LPIPS_ALEX", raising=False)
    with pytest.raises(MissingWeightsError, match=r"AlexNet of ImageNet \(244 MB\) was not found: download https.*"
                       r"alexnet-owt-7be5be79\.pth.*metric\.lpips\.weights=FILE or FRACGEN_LPIPS_ALEX"):  # fmt: skip
        lpips.build(lpips.Settings())
    assert not list(tmp_path.iterdir())


def test_weights_are_found_in_the_cache_and_by_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = tmp_path / "hub" / "checkpoints" / "alexnet-owt-7be5be79.pth"
    place.parent.mkdir(parents=True)
    torch.save(random_weights("alex"), place)
    monkeypatch.setenv("TORCH_HOME", str(tmp_path))
    found = lpips.build(lpips.Settings()).about()["sha256"]
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "nowhere"))
    monkeypatch.setenv("FRACGEN_LPIPS_ALEX", str(place))
    assert lpips.build(lpips.Settings()).about()["sha256"] == found


def test_other_weights_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.pth"
    torch.save({"features.0.weight": torch.zeros(64, 3, 3, 3)}, path)
    with pytest.raises(
        ValueError, match=r"other\.pth.* does not hold the weights of this network: it lacks net\.0\.bia"
    ):
        lpips.build(lpips.Settings(weights=str(path)))
    path.write_bytes(b"version https://git-lfs")
    with pytest.raises(ValueError, match="cannot be read as weights"):
        lpips.build(lpips.Settings(weights=str(path)))


def test_pictures_that_are_too_small_are_refused() -> None:
    network = perceptual.Perceptual(backbones.alexnet())
    small = noise(0, size=24)
    metric = lpips.Lpips.__new__(lpips.Lpips)
    perceptual.PerceptualMetric.__init__(metric, network, 4)
    with pytest.raises(ValueError, match="lpips: pictures of 24 x 24 px are too small, 32 x 32 are needed"):
        metric.scores(small, small)
