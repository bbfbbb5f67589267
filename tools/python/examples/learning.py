"""Learns from images where a hand is touched and how strongly, and says how well on presses that it has not seen."""

import sys

import numpy as np
import torch
from torch.utils.data import DataLoader, Subset

import dermatome
from dermatome.torch import Touches


def main(skin: str, presses: int, epochs: int) -> None:
    torch.manual_seed(0)
    skin_map = dermatome.build(skin)
    readings, truth = dermatome.touch(skin_map, presses=presses, rate=25.0, noise=200.0)
    touches = Touches(skin_map, readings, truth, size=(64, 64))
    touched, first = np.unique(truth["frame"]), truth["frame"][truth["press"] >= presses * 3 // 4].min()
    seen, unseen = (Subset(touches, frames.tolist()) for frames in (touched[touched < first], touched[touched >= first]))
    layers = [torch.nn.Conv2d(channels, 32, 5, stride=2, padding=2) for channels in (2, 32, 32)]
    net = torch.nn.Sequential(*(part for layer in layers for part in (layer, torch.nn.ReLU())), torch.nn.Flatten(), torch.nn.Linear(2048, 4))
    optimizer = torch.optim.Adam(net.parameters(), lr=2e-3)

    def both(batch: dict[str, torch.Tensor | dict[str, torch.Tensor]]) -> tuple[torch.Tensor, torch.Tensor]:
        """What the network says, and what is true: place in dm, and force in N."""
        image, mask, contact = batch["image"], batch["mask"], batch["contact"]
        assert isinstance(image, torch.Tensor) and isinstance(mask, torch.Tensor) and isinstance(contact, dict)
        said: torch.Tensor = net(torch.cat([image / 2e3, mask.float()], dim=1))
        return said, torch.cat([10 * contact["centre"], contact["force"][:, None]], dim=1)

    loader = DataLoader(seen, batch_size=32, shuffle=True, num_workers=2, multiprocessing_context="spawn", persistent_workers=True)
    for _ in range(epochs):
        for batch in loader:
            said, true = both(batch)
            optimizer.zero_grad()
            torch.autograd.backward(torch.nn.functional.mse_loss(said, true))
            optimizer.step()
    with torch.no_grad():
        said, true = both(next(iter(DataLoader(unseen, batch_size=len(unseen)))))
    for name, guess in (("mean guess", true.mean(dim=0).expand_as(true)), ("network", said)):
        away, force = 100 * (guess - true)[:, :3].norm(dim=1).mean(), (guess - true)[:, 3].abs().mean()
        print(f"{name}: {away:.1f} mm, {force:.3f} N")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
