"""The experiment's training, written anew with PyTorch: same data, sizes and protocol, and the best validation loss beside
that of rbres_paper. Nothing of rbres is used but its data set (.npy) and the losses that it reached.

    rbres_paper --out OUT
    python3 compare_pytorch.py OUT free-standard --horizon 0.5 --target residual --blocks 4 --scenarios 20000 --epochs 40

needs PyTorch (1.13 or newer) and NumPy; takes a GPU where there is one. --target residual knows the standard set only.
"""

import argparse
import glob
import json
import os

import numpy as np
import torch
from torch import nn


def rotation_step(q, w):
    """q' = 1/2 q (x) [0, w], q as x, y, z, w."""
    v, s = q[..., :3], q[..., 3:]
    return 0.5 * np.concatenate([s * w + np.cross(v, w), -np.sum(v * w, -1, keepdims=True)], -1)


def contact_free_flow(y, wrench, duration):
    """Fourth-order Runge-Kutta, 0.02 s a step: gravity, air, damping and each body's own wrench on the standard set's balls."""
    mass, radius, moments = 1.0, 0.25, np.array([0.0225, 0.0275, 0.0325])
    air, drag, rotational_drag, damping = 1.2, 0.47, 0.01, 0.05

    def rate(y):
        q, v, w = y[..., 3:7], y[..., 7:10], y[..., 10:13]
        speed, spin = np.linalg.norm(v, axis=-1, keepdims=True), np.linalg.norm(w, axis=-1, keepdims=True)
        force = wrench[..., :3] - 0.5 * air * drag * np.pi * radius**2 * speed * v - damping * mass * v
        torque = wrench[..., 3:] - 0.5 * air * rotational_drag * np.pi * radius**5 * spin * w - damping * moments * w
        acceleration = force / mass + np.array([0, 0, -9.81])
        return np.concatenate([v, rotation_step(q, w), acceleration, (torque - np.cross(w, moments * w)) / moments], -1)

    steps = max(1, int(np.ceil(duration / 0.02 - 1e-9)))
    h = duration / steps
    for _ in range(steps):
        a = rate(y)
        b = rate(y + h / 2 * a)
        c = rate(y + h / 2 * b)
        d = rate(y + h * c)
        y = y + h / 6 * (a + 2 * b + 2 * c + d)
        length = np.linalg.norm(y[..., 3:7], axis=-1, keepdims=True)
        y[..., 3:7] /= np.where(length > 0, length, 1)
    return y


def normalized(x, present, train):
    """(x - mean) / deviation of each number over the present bodies of the training scenarios; absent ones are zero."""
    count = present[train].sum(0)
    mean = np.where(present, x, 0)[train].sum(0) / np.maximum(count, 1)
    deviation = np.sqrt(np.where(present, (x - mean) ** 2, 0)[train].sum(0) / np.maximum(count, 1))
    deviation = np.where(deviation > 1e-12 + 1e-6 * np.abs(mean), deviation, 1)
    return np.where(present, (x - mean) / deviation, 0).astype(np.float32)


def samples(folder, horizon, target, n):
    """Inputs (n, 95), targets (n, 65) and weights (n, 65); test: the first tenth, validation: the second, the rest trains."""
    load = lambda name: np.load(os.path.join(folder, name), mmap_mode="r")[:n].astype(np.float64)
    initial, wrench, truth = load("initial.npy"), load("wrench.npy"), load(f"state_{horizon}s.npy")
    if len(initial) < n:
        raise SystemExit(f"{folder}: expected {n} scenarios, found {len(initial)}")
    present = np.arange(5) < load("body_count.npy")[:, None]
    seen = initial.copy()
    seen[..., 3:7] *= np.where(initial[..., 6:7] < 0, -1, 1)  # q and -q are one orientation
    if target == "residual":
        base = contact_free_flow(initial, wrench, horizon)
        near = base[..., 3:7]
    else:
        base, near = 0, seen[..., 3:7]
    truth[..., 3:7] *= np.where(np.sum(truth[..., 3:7] * near, -1, keepdims=True) < 0, -1, 1)
    inputs, targets = np.concatenate([seen, wrench], -1), truth - base
    train = slice(2 * (n // 10), n)
    spread = lambda numbers: np.repeat(present[:, :, None], numbers, 2).reshape(n, -1)
    return (normalized(inputs.reshape(n, -1), spread(19), train), normalized(targets.reshape(n, -1), spread(13), train),
            spread(13).astype(np.float32))


class Residual(nn.Sequential):
    def forward(self, x):
        return x + super().forward(x)


def network(blocks):
    block = lambda: Residual(nn.Linear(256, 256), nn.ReLU(), nn.Dropout(0.2), nn.Linear(256, 256))
    net = nn.Sequential(nn.Linear(95, 256), nn.ReLU(), *[block() for _ in range(blocks)], nn.Linear(256, 65))
    for layer in net.modules():
        if isinstance(layer, nn.Linear):
            nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
            nn.init.zeros_(layer.bias)
    return net


def train(x, y, weights, blocks, epochs, seed, device):
    """The best validation loss. Adam, rate 1e-3 (1 + 0.1 t)^-0.75, batches of 64, 1e-4 times the sum of squared weights,
    dropout 0.2, stopped after 20 epochs without a better loss."""
    torch.manual_seed(seed)
    net = network(blocks).to(device)
    optimizer = torch.optim.Adam(net.parameters(), lr=1e-3)
    matrices = [p for p in net.parameters() if p.dim() == 2]
    x, y, weights = (torch.from_numpy(a).to(device) for a in (x, y, weights))
    tenth = len(x) // 10
    validation, training = slice(tenth, 2 * tenth), torch.arange(2 * tenth, len(x), device=device)
    loss = lambda rows: (weights[rows] * (net(x[rows]) - y[rows]) ** 2).sum(1).mean()
    best, best_epoch = float("inf"), 0
    for epoch in range(epochs):
        for group in optimizer.param_groups:
            group["lr"] = 1e-3 * (1 + 0.1 * epoch) ** -0.75
        net.train()
        for rows in training[torch.randperm(len(training), device=device)].split(64):
            optimizer.zero_grad()
            (loss(rows) + 1e-4 * sum((w**2).sum() for w in matrices)).backward()
            optimizer.step()
        net.eval()
        with torch.no_grad():
            found = loss(validation).item()
        if found < best:
            best, best_epoch = found, epoch
        if (epoch + 1) % 10 == 0:
            print(f"  epoch {epoch + 1}/{epochs}: validation loss {found:.4f}, best {best:.4f}", flush=True)
        if epoch - best_epoch >= 20:
            break
    return best


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("out", help="rbres_paper's folder: data/ and parts/ are read")
    options.add_argument("place", help="world and set, such as free-standard")
    options.add_argument("--horizon", type=float, default=0.5, help="s")
    options.add_argument("--target", choices=("residual", "state"), default="residual")
    options.add_argument("--blocks", type=int, default=4)
    options.add_argument("--scenarios", type=int, default=20000)
    options.add_argument("--epochs", type=int, default=40)
    options.add_argument("--seeds", type=int, default=3)
    o = options.parse_args()
    if o.target == "residual" and not o.place.endswith("-standard"):
        options.error("--target residual knows the standard set only")
    device = "cuda" if torch.cuda.is_available() else "cpu"
    data = samples(os.path.join(o.out, "data", o.place), o.horizon, o.target, o.scenarios)
    theirs = []
    for seed in range(1, o.seeds + 1):
        print(f"PyTorch {torch.__version__} on {device}, seed {seed}")
        theirs.append(train(*data, o.blocks, o.epochs, seed, device))
    name = f"{o.place}-h{o.horizon:g}-{o.target}-residual{o.blocks}-seed*-n{o.scenarios}-e{o.epochs}.json"
    ours = [json.load(open(path))["found"]["best_validation_loss"]
            for path in sorted(glob.glob(os.path.join(o.out, "parts", name)))]
    text = lambda losses: ", ".join(f"{x:.5g}" for x in losses) + f"; mean {np.mean(losses):.5g}" if losses else "none"
    print(f"best validation loss by seed\n  PyTorch  {text(theirs)}\n  rbres    {text(ours)}")
    if ours:
        print(f"rbres / PyTorch: {np.mean(ours) / np.mean(theirs):.4f}")


if __name__ == "__main__":
    main()
