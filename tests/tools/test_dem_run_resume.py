# SPDX-License-Identifier: GPL-3.0-or-later
"""dem-run: runs that are stopped, killed and taken up again, as if nothing had been."""
import signal
import subprocess
import time

import h5py
import numpy as np

from rank_runs import RankRuns
from talus_tools import BIN, CONFIGURATION, DONE, INPUT, STOPPED, copy_with, datasets, main


class Interruptions(RankRuns):
    """A run of a couple of seconds that is stopped and taken up again must be the run that was never stopped."""

    def prepare(self):
        self.ok("pgbox-gen", "--radius", 0.09, "-o", "box.h5")
        self.ok("tile-trim", "box.h5", "--cuboid", "1.3,1.3,1.3", "--explicit", "-o", "free.h5")
        self.ok("tile-trim", "box.h5", "--cuboid", "1.3,1.3,1.6", "-o", "other.h5")

        def fix(file):  # the lowest grains stay where they are
            file["particles/all/species"] = (file["particles/all/position"][:, 2] < 0.25).astype("u1")

        copy_with(self.folder / "free.h5", self.folder / "model.h5", fix)
        self.write("scene.json", {
            "material": {"friction": 0.4}, "bond": {"bond_pressure": "500Pa", "bond_friction": 1},
            "stress_free_start": True, "time": {"step": "3us"},
            "walls": [{"name": "floor", "plane": {"point": [0, 0, -0.02], "normal": [0, 0, 1]}}],
            "output": {"frame_interval": "50ms", "series_interval": "10ms"},
            "stages": [{"name": "fall", "end": 0.2}, {"name": "rest", "end": 0.3, "damping": {"viscous": 5}}]})
        self.ok("dem-run", *self.arguments("whole.h5"))

    def arguments(self, output="run.h5"):
        return ["model.h5", "-c", "scene.json", "-j", 1, "-q", "-o", output]

    def start(self, *more):
        command = [str(word) for word in (BIN / "dem-run", *self.arguments(), *more)]
        process = subprocess.Popen(command, cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.stderr.close)
        self.addCleanup(process.kill)
        return process

    def wait_for(self, condition, process):
        for _ in range(2000):
            if condition():
                return
            self.assertIsNone(process.poll(), "ended before it could be interrupted: " + str(self.files()))
            time.sleep(0.005)
        self.fail("did not begin")

    def resume_and_compare(self):
        self.assertNotIn("run.h5", self.files())
        self.assertIn("run.ckpt.h5", self.files())
        self.ok("dem-run", *self.arguments(), "--resume", "auto")
        self.assertSamePhysics("run.h5", "whole.h5")
        self.assertFalse([name for name in self.files() if name.startswith("run.") and
                          name not in ("run.h5", "run.xdmf")], "nothing of the interruption stays behind")

    def stop_by(self, stop):
        process = self.start()
        self.wait_for(lambda: (self.folder / "run.h5.part").exists(), process)
        time.sleep(0.15)
        process.send_signal(stop)
        self.assertEqual(process.wait(60), STOPPED)
        lines = process.stderr.read().splitlines()
        self.assertEqual(len(lines), 1)
        self.assertIn("--resume auto", lines[0])
        with h5py.File(self.folder / "run.ckpt.h5", "r") as file:
            self.assertEqual(file["granular"].attrs["kind"], b"checkpoint")
            self.assertEqual(file["granular"].attrs["complete"], 1)
        self.resume_and_compare()

    def test_terminate(self):
        self.stop_by(signal.SIGTERM)

    def test_user_signal(self):
        self.stop_by(signal.SIGUSR1)

    def test_max_wall_again_and_again(self):
        codes = []
        for _ in range(40):
            got = self.run_tool("dem-run", *self.arguments(), "--max-wall", "0.4s", "--resume", "auto")
            codes.append(got.code)
            if got.code != STOPPED:
                break
        self.assertEqual(codes[-1], DONE, str(got))
        self.assertIn(STOPPED, codes)
        self.assertSamePhysics("run.h5", "whole.h5")

    def test_stop_file(self):
        self.write("STOP", "")
        got = self.run_tool("dem-run", *self.arguments())
        self.assertEqual(got.code, STOPPED, str(got))
        self.assertIn("STOP", got.err)
        (self.folder / "STOP").unlink()
        self.resume_and_compare()

    def test_killed(self):
        """Without a chance to write anything: what is there is readable, and the last checkpoint goes on."""
        process = self.start("--checkpoint-interval", "0.2s")
        self.wait_for(lambda: (self.folder / "run.ckpt.h5").exists(), process)
        process.kill()
        process.wait(60)
        self.assertNotIn("run.h5", self.files())
        with h5py.File(self.folder / "run.h5.part", "r") as file:
            self.assertNotEqual(file["granular"].attrs.get("complete", 0), 1)
            self.assertGreater(len(file["particles/all/position/step"]), 0)
            self.assertTrue(np.all(np.isfinite(file["particles/all/position/value"][:])))
        self.resume_and_compare()

    def test_checkpoint_as_input(self):
        got = self.run_tool("dem-run", *self.arguments(), "--max-wall", "0.4s", "--checkpoint", "saved.h5")
        self.assertEqual(got.code, STOPPED, str(got))
        self.ok("dem-run", "saved.h5", "-c", "scene.json", "-o", "rest.h5")
        first, second = datasets(self.folder / "whole.h5"), datasets(self.folder / "rest.h5")
        np.testing.assert_array_equal(first["particles/all/position/value"][-1],
                                      second["particles/all/position/value"][-1])
        self.assertEqual(first["particles/all/position/step"][-1], second["particles/all/position/step"][-1])

    def test_damaged_checkpoint(self):
        """A torn checkpoint is refused, or the one before it or the start is taken and a line says so."""
        self.assertEqual(self.run_tool("dem-run", *self.arguments(), "--max-wall", "0.4s").code, STOPPED)
        saved = self.folder / "run.ckpt.h5"
        saved.write_bytes(saved.read_bytes()[:3000])
        arguments = [word for word in self.arguments() if word != "-q"]
        got = self.run_tool("dem-run", *arguments, "--resume", "auto", "--progress", "none")
        self.assertIn(got.code, (DONE, INPUT), str(got))
        self.assertIn("run.ckpt.h5", got.err)

    def test_checkpoint_of_another_run(self):
        """Going on with another model, step or scene would be neither this run nor that."""
        self.assertEqual(self.run_tool("dem-run", *self.arguments(), "--max-wall", "0.3s").code, STOPPED)
        for what, arguments in (("model", ["other.h5", *self.arguments()[1:]]),
                                ("step", [*self.arguments(), "--time.step", "10us"]),
                                ("friction", [*self.arguments(), "--material.friction", 0.1])):
            with self.subTest(what):
                got = self.run_tool("dem-run", *arguments, "--resume", "auto", "--max-wall", "0.3s")
                self.assertIn(got.code, (CONFIGURATION, INPUT), str(got))
                self.assertEqual(len(got.err.splitlines()), 1, str(got))

    def test_several_materials(self):
        """Which grain is of which material survives, and going on with others is refused."""
        def label(numbers):
            return lambda file: file["particles/all"].create_dataset(
                "material", data=numbers(len(file["particles/all/radius"])).astype("u1"))

        copy_with(self.made / "model.h5", self.folder / "model.h5", label(lambda n: np.arange(n) % 2))
        copy_with(self.made / "model.h5", self.folder / "other.h5", label(lambda n: np.arange(n) // 2 % 2))
        scene = {"material": {"friction": 0.4}, "time": {"step": "4us", "end": "0.4s"},
                 "materials": [{"density": 3000, "youngs_modulus": "300MPa", "friction": 0.1}],
                 "walls": [{"name": "floor", "plane": {"point": [0, 0, -0.02], "normal": [0, 0, 1]}}],
                 "output": {"frame_interval": "50ms", "series_interval": "10ms"}}
        self.write("scene.json", scene)
        self.ok("dem-run", *self.arguments("whole.h5"), "--overwrite")
        got = self.run_tool("dem-run", *self.arguments(), "--max-wall", "0.25s")
        self.assertEqual(got.code, STOPPED, str(got))
        self.fails(INPUT, "dem-run", "other.h5", *self.arguments()[1:], "--resume", "auto", names="another model")
        self.fails(CONFIGURATION, "dem-run", *self.arguments(), "--set", "materials=[{}]", "--resume", "auto",
                   names="/materials/0")
        self.resume_and_compare()

    def test_resume_without_a_checkpoint(self):
        self.ok("dem-run", *self.arguments(), "--resume", "auto", "--set", 'stages=[{"end": 0.01}]')


if __name__ == "__main__":
    main()
