# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests of the tools share: running a tool, making its files, damaging them and looking into them.

    TALUS_BIN=build/release/bin /usr/bin/python3 tests/tools/test_dem_run.py [-k name]

TALUS_BIN is the folder of the tools, TALUS_DATA the data samples (default: those beside this folder).
"""
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree

try:
    import h5py
    import numpy as np
except ImportError as missing:
    sys.exit(f"{missing}: install python3-h5py and python3-numpy, or run with the interpreter that has them")

ROOT = pathlib.Path(__file__).resolve().parents[2]
BIN = pathlib.Path(os.environ.get("TALUS_BIN", ROOT / "build" / "release" / "bin")).resolve()
DATA = pathlib.Path(os.environ.get("TALUS_DATA", ROOT / "data-samples")).resolve()
HELENS = DATA / "st-helens-2021"
DEGREES = DATA / "jacksboro" / "jacksboro_degrees.asc"

DONE, FAILED, USAGE, CONFIGURATION, INPUT, EXISTS, QUALITY, STOPPED = 0, 1, 2, 3, 4, 5, 6, 75


class Result:
    """Exit code, standard output and standard error of one run."""

    def __init__(self, process):
        self.code, self.out, self.err = process.returncode, process.stdout or "", process.stderr
        self.command = " ".join(str(word) for word in process.args)

    @property
    def json(self):
        return json.loads(self.out)

    def __str__(self):
        return f"{self.command}\nexit {self.code}\nstdout: {self.out[-2000:]}\nstderr: {self.err[-2000:]}"


def words(*args):
    return [str(word) for word in args]


class ToolTest(unittest.TestCase):
    """A temporary folder per test, in which the tools run."""

    maxDiff = None
    tool = None  # the tool of this script

    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="talus-test-"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)

    def run_tool(self, tool, *args, stdout=subprocess.PIPE, wrapper=(), timeout=300):
        command = [*words(*wrapper), str(BIN / tool), *words(*args)]
        return Result(subprocess.run(command, cwd=self.folder, stdin=subprocess.DEVNULL, stdout=stdout,
                                     stderr=subprocess.PIPE, text=True, timeout=timeout))

    def ok(self, tool, *args, **options):
        """Runs a tool that must succeed."""
        got = self.run_tool(tool, *args, **options)
        self.assertEqual(got.code, DONE, str(got))
        return got

    def fails(self, code, tool, *args, names=(), **options):
        """Runs a tool that must fail with this code and one line on standard error that holds `names`."""
        got = self.run_tool(tool, *args, **options)
        self.assertEqual(got.code, code, str(got))
        self.assertEqual(got.out, "", str(got))
        self.assertEqual(len(got.err.splitlines()), 1, f"one line expected\n{got}")
        self.assertTrue(got.err.startswith(f"{tool}: error: "), str(got))
        for name in [names] if isinstance(names, str) else names:
            self.assertIn(str(name), got.err, str(got))
        return got

    def files(self, folder=None):
        return sorted(path.name for path in pathlib.Path(folder or self.folder).iterdir())

    def write(self, name, text):
        path = self.folder / name
        path.write_text(text if isinstance(text, str) else json.dumps(text))
        return name

    def small_disk(self, kilobytes):
        """A wrapper that runs a command in a view of the system where ./disk is a file system of that size; what is
        left on it is listed in ./left. Skips the test where that is not allowed."""
        (self.folder / "disk").mkdir(exist_ok=True)
        unshare = shutil.which("unshare")
        if not unshare:
            self.skipTest("unshare is not installed")
        who = ["-m"] if os.geteuid() == 0 else ["-r", "-m"]
        script = (f'mount -t tmpfs -o size={kilobytes}k none disk || exit 99; "$@"; code=$?; ls -A disk > left; '
                  'exit $code')
        wrapper = [unshare, *who, "/bin/sh", "-c", script, "sh"]
        if subprocess.run([*wrapper, "true"], cwd=self.folder, capture_output=True).returncode != 0:
            self.skipTest("a small file system cannot be mounted here")
        return wrapper

    def left_on_disk(self):
        return (self.folder / "left").read_text().split()


# Files of other programs ------------------------------------------------------------------------------------------

def write_model(path, position, radius, **columns):
    """The smallest model that another program may write."""
    with h5py.File(path, "w") as file:
        granular = file.create_group("granular")
        granular.attrs["kind"] = "model"
        granular.attrs["complete"] = 1
        file["particles/all/position"] = np.array(position, dtype=float)
        file["particles/all/radius"] = np.array(radius, dtype=float)
        for name, values in columns.items():
            file[f"particles/all/{name}"] = np.array(values)


def datasets(path):
    """Every dataset of a file as an array, by its path; one with several names under each of them."""
    found = {}

    def walk(group, prefix):
        for name, item in group.items():
            if isinstance(item, h5py.Dataset):
                found[prefix + name] = item[()]
            else:
                walk(item, f"{prefix}{name}/")

    with h5py.File(path, "r") as file:
        walk(file, "")
    return found


def physical(path):
    """The datasets without those that tell how the file was made."""
    return {name: value for name, value in datasets(path).items()
            if not name.startswith(("granular/provenance", "parameters"))}


def copy_with(source, target, change):
    """A copy of an HDF5 file that `change(file)` has edited, checksums right."""
    shutil.copyfile(source, target)
    with h5py.File(target, "r+") as file:
        change(file)


def flip_byte(source, target, dataset):
    """A copy of an HDF5 file with one bit of the dataset's first chunk turned."""
    with h5py.File(source, "r") as file:
        identifier = file[dataset].id
        if identifier.get_create_plist().get_layout() == h5py.h5d.CHUNKED:
            chunk = identifier.get_chunk_info(0)
            at = chunk.byte_offset + chunk.size // 2
        else:
            at = identifier.get_offset() + identifier.get_storage_size() // 2
    data = bytearray(source.read_bytes())
    data[at] ^= 0x10
    target.write_bytes(data)


def is_fletcher32(path, dataset):
    with h5py.File(path, "r") as file:
        return bool(file[dataset].fletcher32)


# XDMF -------------------------------------------------------------------------------------------------------------

def check_xdmf(test, sidecar):
    """Parses a sidecar and looks up every dataset it names: there, with these dimensions and of this type."""
    sidecar = pathlib.Path(sidecar)
    root = xml.etree.ElementTree.parse(sidecar).getroot()
    test.assertEqual(root.tag, "Xdmf")
    seen = []
    for parent in root.iter():
        for item in parent.findall("DataItem"):
            if item.get("Format") != "HDF":
                continue
            file_name, path = item.text.strip().split(":", 1)
            with h5py.File(sidecar.parent / file_name, "r") as file:
                test.assertIn(path, file, f"{sidecar}: {path}")
                dataset = file[path]
                dimensions = tuple(int(n) for n in item.get("Dimensions").split())
                test.assertEqual(dimensions, dataset.shape, path)
                kinds = {"Float": "f", "Int": "i", "UInt": "u", "UChar": "u", "Char": "i"}
                test.assertEqual(kinds[item.get("NumberType")], dataset.dtype.kind, path)
                test.assertEqual(int(item.get("Precision")), dataset.dtype.itemsize, path)
            if parent.get("ItemType") == "HyperSlab":
                slab = np.array(parent.find("DataItem[@Format='XML']").text.split(), dtype=int)
                start, stride, count = slab.reshape(3, -1)
                test.assertTrue(np.all(start + stride * (count - 1) < dimensions), f"{sidecar}: {slab}")
                shape = tuple(int(n) for n in parent.get("Dimensions").split())
                test.assertEqual(tuple(count[1:]), shape, f"{sidecar}: {path}")
            seen.append(path)
    test.assertTrue(seen, f"{sidecar} names no dataset")
    for grid in root.iter("Grid"):
        topology = grid.find("Topology")
        if topology is not None:
            item = grid.find("Geometry/DataItem")
            test.assertEqual(topology.get("NumberOfElements"), item.get("Dimensions").split()[0])
    times = [float(time.get("Value")) for time in root.iter("Time")]
    return seen, times


def main():
    if not (BIN / "dem-run").exists():
        sys.exit(f"{BIN}: no tools here; build them, or name their folder in TALUS_BIN")
    unittest.main(verbosity=2)
