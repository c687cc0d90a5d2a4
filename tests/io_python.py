"""Files against Python: NumPy's own .npy, and safetensors as their specification says (struct, json, NumPy).

usage: io_python.py IO_PYTHON_COPY. Exits with 77 (skipped) where there is no NumPy.
"""

import hashlib
import json
import pathlib
import re
import struct
import subprocess
import sys
import tempfile

try:
    import numpy as np
except ImportError:
    print("skipped: this Python has no NumPy")
    sys.exit(77)


def copy(how, source, target):
    return subprocess.run([sys.argv[1], how, source, target], capture_output=True, text=True)


def check_npy(folder):
    source, target = folder / "source.npy", folder / "target.npy"
    random = np.random.default_rng(1)
    for dtype in ("float32", "float64", "int32", "int64", "uint8"):
        for shape in ((7,), (5, 3), (4, 3, 2), (2, 4, 3, 2), (0, 3), (3, 0), (1, 1)):
            for version in ((1, 0), (2, 0), (3, 0)):
                array = (100 * random.random(shape)).astype(dtype)
                with open(source, "wb") as file:
                    np.lib.format.write_array(file, array, version)
                done = copy(dtype, source, target)
                assert done.returncode == 0, done.stderr
                back = np.load(target)
                assert back.dtype == array.dtype and back.shape == array.shape
                assert np.array_equal(back, array), (dtype, shape)
    for array in (np.asfortranarray(random.random((3, 2))), random.random((3, 2)).astype(">f8"),
                  random.random((3, 2)) > 0.5, random.random((1, 1, 1, 1, 1)), np.array(1.0)):
        np.save(source, array)
        done = copy("float64", source, target)
        assert done.returncode == 2 and str(source) in done.stderr, (array, done)


def check_digest(data):
    """The file's own digest is the SHA-256 of its bytes with zeros in the digest's place."""
    at = re.search(rb'"sha256": ?"([0-9a-f]{64})"', data).start(1)
    assert hashlib.sha256(data[:at] + b"0" * 64 + data[at + 64:]).hexdigest().encode() == data[at:at + 64]


def read_safetensors(path):
    data = path.read_bytes()
    (size,) = struct.unpack("<Q", data[:8])
    header = json.loads(data[8:8 + size])
    assert size % 8 == 0 and all(t["dtype"] == "F32" for name, t in header.items() if name != "__metadata__")
    metadata = header.pop("__metadata__")
    tensors = {name: np.frombuffer(data[8 + size:], "<f4")[t["data_offsets"][0] // 4:t["data_offsets"][1] // 4]
               .reshape(t["shape"]) for name, t in header.items()}
    return tensors, metadata


def check_safetensors(folder):
    array = np.arange(12, dtype="float32").reshape(4, 3)
    np.save(folder / "array.npy", array)
    done = copy("safetensors", folder / "array.npy", folder / "array.safetensors")
    assert done.returncode == 0, done.stderr
    tensors, metadata = read_safetensors(folder / "array.safetensors")
    assert metadata == {"made by": "rbres"} and np.array_equal(tensors["array"], array)

    header = {"array": {"dtype": "F32", "shape": [3, 4], "data_offsets": [0, 48]}}
    text = json.dumps(header).encode()
    (folder / "python.safetensors").write_bytes(struct.pack("<Q", len(text)) + text + array.tobytes())
    done = copy("npy", folder / "python.safetensors", folder / "back.npy")
    assert done.returncode == 0, done.stderr
    assert np.array_equal(np.load(folder / "back.npy"), array.reshape(3, 4))


def check_network(folder):
    """The network as PyTorch would build it from the file's state_dict gives the outputs that the file promises."""
    first, second = folder / "network.safetensors", folder / "again.safetensors"
    done = copy("network", "", first)
    assert done.returncode == 0, done.stderr
    w, metadata = read_safetensors(first)
    check_digest(first.read_bytes())
    layers = ("0", "2.0", "2.3", "3.0", "3.3", "4")
    assert set(w) == {f"{layer}.{part}" for layer in layers for part in ("weight", "bias")}
    probe_inputs, probe_outputs = (np.array(metadata[key].split(), "float32").reshape(3, -1)
                                   for key in ("probe_inputs", "probe_outputs"))
    x = np.maximum(probe_inputs @ w["0.weight"].T + w["0.bias"], 0)
    for block in ("2", "3"):
        hidden = np.maximum(x @ w[f"{block}.0.weight"].T + w[f"{block}.0.bias"], 0)
        x = x + hidden @ w[f"{block}.3.weight"].T + w[f"{block}.3.bias"]
    y = x @ w["4.weight"].T + w["4.bias"]
    assert np.abs(y - probe_outputs).max() < 1e-5 * np.abs(y).max()

    # As Python's safetensors writes a state_dict: tensors by name, no metadata.
    header, data = {}, b""
    for name in sorted(w):
        header[name] = {"dtype": "F32", "shape": w[name].shape, "data_offsets": [len(data), len(data) + w[name].nbytes]}
        data += w[name].tobytes()
    text = json.dumps(header).encode()
    (folder / "python.safetensors").write_bytes(struct.pack("<Q", len(text)) + text + data)
    done = copy("network", folder / "python.safetensors", second)
    assert done.returncode == 0, done.stderr
    assert first.read_bytes() == second.read_bytes()


def check_dataset(folder):
    done = copy("dataset", "", folder / "set")
    assert done.returncode == 0, done.stderr
    arrays = {path.stem: np.load(path) for path in (folder / "set").glob("*.npy")}
    assert {name: (a.dtype.name, a.shape) for name, a in arrays.items()} == {
        "initial": ("float32", (60, 5, 13)), "wrench": ("float32", (60, 5, 6)),
        "state_0.02s": ("float32", (60, 5, 13)), "state_1.0s": ("float32", (60, 5, 13)),
        "body_count": ("uint8", (60,)), "family": ("uint8", (60,)), "first_contact": ("float32", (60,)),
        "impacts": ("int32", (60, 2))}
    check_digest((folder / "set" / "dataset.json").read_bytes())
    setting = json.loads((folder / "set" / "dataset.json").read_text())
    assert setting["arrays"] == {path.name: hashlib.sha256(path.read_bytes()).hexdigest()
                                 for path in (folder / "set").glob("*.npy")}
    assert setting["world"] == "room" and setting["seed"] == 3 and setting["horizons"] == [0.02, 1.0]
    assert setting["scenarios"] == setting["done"] == 60
    present = np.arange(5) < arrays["body_count"][:, None]
    for name in ("initial", "wrench", "state_0.02s", "state_1.0s"):
        assert (arrays[name][~present] == 0).all() and (arrays[name][present] != 0).any(axis=-1).all(), name
    start, later = arrays["initial"], arrays["state_0.02s"]
    free = present & (arrays["first_contact"] > 0.03)[:, None]
    assert free.any() and np.abs(later - start)[free][:, :3].max() > 0.05
    assert np.abs(later[..., :3] - start[..., :3] - 0.02 * start[..., 7:10])[free].max() < 0.01
    assert np.abs(np.linalg.norm(later[present][:, 3:7], axis=-1) - 1).max() < 1e-6
    assert sorted(set(arrays["family"])) == [3, 4] and (arrays["first_contact"] > 0).all()
    assert (arrays["impacts"][:, 1] > 0).any()
    assert ((arrays["impacts"][:, 1] > 0) == (arrays["first_contact"] <= 1)).all()


with tempfile.TemporaryDirectory() as name:
    check_npy(pathlib.Path(name))
    check_safetensors(pathlib.Path(name))
    check_network(pathlib.Path(name))
    check_dataset(pathlib.Path(name))
