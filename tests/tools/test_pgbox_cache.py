# SPDX-License-Identifier: GPL-3.0-or-later
"""pipelines/pgbox-cache: a box is made once for its settings, also when two ask at once, and never half."""
import json
import os
import pathlib
import signal
import subprocess
import time

from talus_tools import BIN, CONFIGURATION, DONE, EXISTS, QUALITY, ROOT, USAGE, Result, ToolTest, main, words

CACHE = ROOT / "pipelines" / "pgbox-cache"


class PgboxCache(ToolTest):
    def start(self, *args):
        environment = dict(os.environ, TALUS_CACHE=str(self.folder / "cache"))
        return subprocess.Popen([str(CACHE), str(BIN / "pgbox-gen"), *words(*args)], cwd=self.folder, env=environment,
                                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def cached(self, *args, code=DONE):
        process = self.start(*args)
        process.stdout, process.stderr = process.communicate(timeout=120)
        got = Result(process)
        self.assertEqual(got.code, code, str(got))
        return got

    def entries(self):
        return [path for path in (self.folder / "cache").iterdir() if not path.name.startswith(".")]

    def test_made_once(self):
        first = self.cached("--radius", 0.09, "-o", "a.pgbox.h5", "--format", "json").json
        self.assertIs(first["cached"], False)
        # Other words for the same settings, and what does not change the result.
        for arguments in (["--radius", "9cm"], ["--set", "radius=0.09", "-j", 1], ["--radius", 0.09, "--progress", "none"]):
            again = self.cached(*arguments, "-o", "b.pgbox.h5", "--overwrite", "--format", "json").json
            self.assertEqual(again, {**first, "cached": True})
        self.assertEqual((self.folder / "a.pgbox.h5").read_bytes(), (self.folder / "b.pgbox.h5").read_bytes())
        self.ok("pgbox-stats", "b.pgbox.h5")
        other = self.cached("--radius", 0.09, "--seed", 2, "-o", "c.pgbox.h5", "--format", "json").json
        self.assertIs(other["cached"], False)
        self.assertEqual(len(self.entries()), 2)
        made_by = json.loads((self.entries()[0] / "made_by.json").read_text())
        self.assertEqual(made_by["settings"]["radius"], 0.09)

    def test_a_changed_grading_is_another_box(self):
        made = []
        for finer in (40, 60):
            self.write("soil.csv", f"diameter,percent_finer\n1mm,0\n1.5mm,{finer}\n2mm,100\n")
            made.append(self.cached("--radius", 0.12, "--grading", "soil.csv", "--solid-volume-fraction", 0.67, "-o",
                                    "a.pgbox.h5", "--overwrite", "--format", "json").json)
        self.assertEqual([result["cached"] for result in made], [False, False])
        self.assertNotEqual(made[0]["particle_count"], made[1]["particle_count"])

    def test_two_at_once(self):
        both = [self.start("--radius", 0.05, "-o", f"{name}.pgbox.h5", "--format", "json") for name in "ab"]
        results = [json.loads(process.communicate(timeout=120)[0]) for process in both]
        self.assertEqual(sorted(result["cached"] for result in results), [False, True])
        self.assertEqual((self.folder / "a.pgbox.h5").read_bytes(), (self.folder / "b.pgbox.h5").read_bytes())

    def test_killed_while_it_makes_one(self):
        process = self.start("--radius", 0.03, "-o", "a.pgbox.h5")
        cache = self.folder / "cache"
        deadline = time.monotonic() + 20
        while time.monotonic() < deadline and not (cache.is_dir() and any(cache.glob(".*.part"))):
            time.sleep(0.01)
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=60)
        self.assertEqual(process.returncode, 128 + signal.SIGTERM)
        self.assertFalse((self.folder / "a.pgbox.h5").exists())
        self.assertEqual(self.entries(), [])
        self.assertEqual(list(cache.glob(".*.part")), [])

    def test_failures_are_those_of_pgbox_gen_and_are_not_kept(self):
        self.assertIn("iterations", self.cached("--radius", 0.06, "--iterations", 20, "-o", "a.pgbox.h5",
                                                code=QUALITY).err)
        self.assertIn("--radios", self.cached("--radios", 0.06, "-o", "a.pgbox.h5", code=USAGE).err)
        self.assertIn("radius", self.cached("--radius", 0.6, "-o", "a.pgbox.h5", code=CONFIGURATION).err)
        self.assertEqual(self.entries(), [])
        self.assertFalse((self.folder / "a.pgbox.h5").exists())
        self.assertIn("-o", self.cached("--radius", 0.09, code=USAGE).err)
        pathlib.Path(self.folder / "a.pgbox.h5").write_text("mine")
        self.cached("--radius", 0.09, "-o", "a.pgbox.h5", code=EXISTS)
        self.assertEqual((self.folder / "a.pgbox.h5").read_text(), "mine")


if __name__ == "__main__":
    main()
