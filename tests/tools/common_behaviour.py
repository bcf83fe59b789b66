# SPDX-License-Identifier: GPL-3.0-or-later
"""What all six tools have in common: switches, configuration, exit codes, damaged input, full disks."""
import csv
import io
import json

from talus_tools import (CONFIGURATION, DONE, EXISTS, FAILED, INPUT, USAGE, copy_with, flip_byte, write_model)


class CommonBehaviour:
    """Mixed into a ToolTest: `tool`, and
    `input()`    makes a good input in the folder and returns its name, None where the tool has none;
    `arguments`  what the tool needs beside input and output;
    `wrong_kind` "pgbox" or "model": a file of ours that is not for this tool;
    `damaged`    datasets of the input that the tool reads;
    `keys`       of its JSON result."""

    arguments = ()
    output = "out.h5"
    result_in_output = False  # the result goes to OUTPUT, where one is named, not to standard output
    needs_output = True
    wrong_kind = None
    damaged = ()
    keys = ()

    def command(self, *more, output=None, source=None):
        made = [source] if source else [self.input()] if self.input() else []
        target = output or (self.output if self.needs_output else None)
        return [*made, *self.arguments, *(["-o", target] if target else []), *more]

    def box(self, name="box.pgbox.h5"):
        if not (self.folder / name).exists():
            self.ok("pgbox-gen", "--radius", 0.09, "-j", 1, "-o", name)
        return name

    def test_help(self):
        for switch in ("-h", "--help"):
            got = self.ok(self.tool, switch)
            self.assertEqual(got.err, "")
            self.assertIn(f"Usage: {self.tool} ", got.out)
            self.assertIn("-o", got.out)
            self.assertEqual("INPUT" in got.out, self.input() is not None)
            for word in ("--output", "--overwrite", "--config", "--print-config", "--dry-run", "--format", "--threads",
                         "--progress", "--seed", "--no-provenance", "--version"):
                self.assertIn(word, got.out)

    def test_version(self):
        got = self.ok(self.tool, "--version")
        self.assertEqual(got.err, "")
        self.assertRegex(got.out.splitlines()[0], rf"^{self.tool} .*\d+\.\d+\.\d+")
        for word in ("libraries:", "compiler:", "flags:", "SIMD target:"):
            self.assertIn(word, got.out)

    def test_usage_errors(self):
        target = self.command()
        self.fails(USAGE, self.tool, *target, "--no-such-switch", names="--no-such-switch")
        self.fails(USAGE, self.tool, *target, "--overwite", names="did you mean --overwrite?")
        self.fails(USAGE, self.tool, *target, "--format", "xml", names=["--format", "xml", "json"])
        self.fails(USAGE, self.tool, *target, "-j", "many", names='"many"')
        self.fails(USAGE, self.tool, *target, "--set", "nothing", names="key=value")
        if self.needs_output:
            without = [word for word in target if word not in ("-o", self.output)]
            self.fails(USAGE, self.tool, *without, names="-o")
        self.assertNotIn(self.output, self.files())

    def test_configuration_errors_are_listed_at_once(self):
        self.write("bad.json", '{\n  // a comment\n  "sed": 1,\n  "threads": -2,\n  "format": "xml"\n}\n')
        got = self.run_tool(self.tool, *self.command("-c", "bad.json"))
        self.assertEqual(got.code, CONFIGURATION, str(got))
        self.assertEqual(got.out, "")
        lines = got.err.splitlines()
        self.assertEqual(len(lines), 3, str(got))
        self.assertRegex(lines[0], r'^bad\.json:3:3: error: /sed: .*unknown key.*"seed"')
        self.assertRegex(lines[1], r"^bad\.json:4:\d+: error: /threads: found -2, expected ")
        self.assertRegex(lines[2], r'^bad\.json:5:\d+: error: /format: found "xml", expected .*json')
        self.assertNotIn(self.output, self.files())

    def test_configuration_file_that_is_none(self):
        self.write("cut.json", '{"seed": 1,\n "threads": ')
        got = self.run_tool(self.tool, *self.command("-c", "cut.json"))
        self.assertEqual(got.code, CONFIGURATION, str(got))
        self.assertRegex(got.err, r"^cut\.json:2:\d+: error: ")
        got = self.run_tool(self.tool, *self.command("-c", "absent.json"))
        self.assertIn(got.code, (CONFIGURATION, INPUT), str(got))
        self.assertIn("absent.json", got.err)

    def test_print_config_reads_back(self):
        first = self.ok(self.tool, *self.arguments, "--seed", 42, "--print-config")
        self.assertEqual(json.loads(first.out)["seed"], 42)
        self.write("config.json", first.out)
        second = self.ok(self.tool, "-c", "config.json", "--print-config")
        self.assertEqual(first.out, second.out)
        third = self.ok(self.tool, "-c", "config.json", "--seed", 43, "--print-config")
        self.assertEqual(json.loads(third.out)["seed"], 43, "a switch wins over the file")

    def test_existing_output(self):
        target = self.output if self.needs_output else "out.json"
        (self.folder / target).write_text("precious")
        self.fails(EXISTS, self.tool, *self.command(output=target), names=[target, "--overwrite"])
        self.assertEqual((self.folder / target).read_text(), "precious")
        self.ok(self.tool, *self.command("--overwrite", "-q", output=target))
        self.assertNotEqual((self.folder / target).read_bytes(), b"precious")
        self.assertFalse([name for name in self.files() if name.endswith((".part", ".tmp"))])

    def test_dry_run_does_nothing(self):
        command = self.command("-n", "--format", "json")
        before = self.files()
        got = self.ok(self.tool, *command)
        self.assertIsInstance(got.json, dict)
        self.assertEqual(self.files(), before)

    def test_formats(self):
        got = self.ok(self.tool, *self.command("--format", "json", "--overwrite"))
        for key in ("schema", "version", *self.keys):
            self.assertIn(key, got.json)
        self.assertEqual(got.json["schema"], self.tool)
        table = self.ok(self.tool, *self.command("--format", "csv", "--overwrite"))
        rows = list(csv.reader(io.StringIO(table.out)))
        self.assertEqual(rows[0], ["key", "value"])
        self.assertTrue(all(len(row) == 2 for row in rows), str(table))
        self.assertTrue(set(self.keys) <= {row[0].split(".")[0] for row in rows}, str(table))
        text = self.ok(self.tool, *self.command("--overwrite"))
        self.assertTrue(text.out.strip())
        with self.assertRaises(ValueError):
            json.loads(text.out)

    def test_progress_and_quiet(self):
        got = self.ok(self.tool, *self.command("-q", "--overwrite"))
        self.assertEqual(got.err, "")
        got = self.ok(self.tool, *self.command("--progress", "json", "--overwrite"))
        for line in got.err.splitlines():
            if not line.startswith(f"{self.tool}: "):
                self.assertIsInstance(json.loads(line), dict)

    def test_full_standard_output(self):
        for arguments in (["--help"], self.command("-q")):
            with open("/dev/full", "w") as full:
                got = self.run_tool(self.tool, *arguments, stdout=full)
            self.assertEqual(got.code, FAILED, str(got))
            self.assertEqual(len(got.err.splitlines()), 1, str(got))
            self.assertIn("standard output", got.err)

    def test_full_disk(self):
        """A few kilobytes are not enough for any output: one line, and nothing stays behind."""
        name = "disk/" + (self.output if self.needs_output else "out.json")
        wrapper = self.small_disk(4 if not self.needs_output else 12)
        if not self.needs_output:  # such results are small: fill the disk first
            wrapper[-2] = wrapper[-2].replace('"$@"', 'cat /dev/zero > disk/full 2>/dev/null; "$@"')
        self.fails(FAILED, self.tool, *self.command(output=name), names=name, wrapper=wrapper)
        self.assertEqual([file for file in self.left_on_disk() if file != "full"], [])

    def test_file_size_limit(self):
        """As a batch system sets it. Neither a signal nor a piece of a file."""
        target = self.output if self.needs_output else "out.json"
        command = self.command(output=target)
        before = self.files()
        wrapper = ["/bin/sh", "-c", f'ulimit -f {1 if not self.needs_output else 16}; exec "$@"', "sh"]
        got = self.run_tool(self.tool, *command, wrapper=wrapper)
        if got.code == DONE and not self.needs_output:
            self.assertLessEqual((self.folder / target).stat().st_size, 1024)
            return
        self.assertEqual(got.code, FAILED, str(got))
        self.assertEqual(len(got.err.splitlines()), 1, str(got))
        self.assertIn(target, got.err)
        self.assertEqual(self.files(), before)

    def test_folder_that_is_not_there(self):
        self.fails(FAILED, self.tool, *self.command(output="nowhere/out.h5"), names="nowhere")


class ReadsInput(CommonBehaviour):
    """The five tools that read a file of ours."""

    def test_input_is_needed(self):
        without = self.command()[1:]
        self.fails(USAGE, self.tool, *without)

    def test_missing_input(self):
        self.fails(INPUT, self.tool, *self.command(source="absent.h5"), names="absent.h5")
        self.fails(INPUT, self.tool, *self.command(source="."), names=".")
        self.assertNotIn(self.output, self.files())

    def test_files_that_are_not_for_it(self):
        good = (self.folder / self.input()).read_bytes()
        self.write("text.h5", "not HDF5\n")
        self.write("empty.h5", "")
        (self.folder / "truncated.h5").write_bytes(good[:len(good) * 2 // 3])
        copy_with(self.folder / self.input(), self.folder / "unfinished.h5",
                  lambda file: file["granular"].attrs.modify("complete", 0))
        if self.wrong_kind == "pgbox":
            self.box("wrong.h5")
        else:
            write_model(self.folder / "wrong.h5", [[0, 0, 0]], [1])
        for name in ("text.h5", "empty.h5", "truncated.h5", "unfinished.h5", "wrong.h5"):
            with self.subTest(name):
                self.fails(INPUT, self.tool, *self.command(source=name), names=name)
        self.assertFalse([name for name in self.files() if name.startswith("out")])

    def test_flipped_byte(self):
        source = self.folder / self.input()
        for dataset in self.damaged:
            with self.subTest(dataset):
                flip_byte(source, self.folder / "flipped.h5", dataset)
                self.fails(INPUT, self.tool, *self.command(source="flipped.h5"), names=["flipped.h5", dataset])
        self.assertFalse([name for name in self.files() if name.startswith("out")])
