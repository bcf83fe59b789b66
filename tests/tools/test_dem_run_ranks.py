# SPDX-License-Identifier: GPL-3.0-or-later
"""dem-run on several ranks: bit for bit the run on one, whatever the scene, stopped or not; one voice to the user."""
import h5py
import numpy as np

from rank_runs import RankRuns, mpirun
from scenes import RADIUS
from talus_tools import CONFIGURATION, DONE, EXISTS, INPUT, STOPPED, datasets, main, write_model


class Slide(RankRuns):
    """A slope with a fixed layer, bonds, release, frames and a series."""

    def prepare(self):
        self.make_slope("slope.h5")
        self.make_slope("explicit.h5", "--explicit")
        type(self).longer = ["--time.step_fraction", self.fraction_for(1.2)]
        self.write_slide(0.1)
        result = self.ok("dem-run", *self.arguments("whole.h5"), "--format", "json").json
        for event in ("bonds", "bonds_broken", "bonds_released"):
            self.assertGreater(result[event], 10, event)
        self.assertLess(result["mobile_count"], result["particle_count"])

    def same_as_whole(self, ranks, *more, model="slope.h5"):
        got = self.ok("dem-run", *self.arguments(model=model), *more, "--format", "json", wrapper=mpirun(ranks)).json
        self.assertEqual(got["ranks"], ranks)
        self.assertSamePhysics("run.h5", "whole.h5")
        return got

    def test_two(self):
        self.same_as_whole(2)

    def test_four(self):
        self.same_as_whole(4)

    def test_eight(self):
        got = self.same_as_whole(8)
        self.assertEqual(len(got["rank_particles"]), 8)
        self.assertEqual(sum(got["rank_particles"]), got["particle_count"])

    def test_ranks_with_threads(self):
        self.assertEqual(self.same_as_whole(2, "-j", 2)["threads"], 2)

    def test_explicit(self):
        """The other form of the same model: of one every rank reads rows, of the other it expands tiles."""
        with h5py.File(self.folder / "explicit.h5", "r") as explicit, h5py.File(self.folder / "slope.h5", "r") as tiled:
            self.assertIn("particles/all/position", explicit)
            self.assertNotIn("particles/all/position", tiled)
        self.same_as_whole(3, model="explicit.h5")

    def test_stopped_and_resumed_on_others(self):
        self.ok("dem-run", *self.arguments("whole.h5"), *self.longer, "--overwrite")
        got = self.run_tool("dem-run", *self.arguments(), *self.longer, "--max-wall", "0.2s", wrapper=mpirun(2))
        self.assertEqual(got.code, STOPPED, str(got))
        self.assertEqual(len(got.err.splitlines()), 1, f"one line for all ranks\n{got}")
        self.assertIn("--resume auto", got.err)
        with h5py.File(self.folder / "run.ckpt.h5", "r") as file:
            self.assertGreater(file["granular/checkpoint"].attrs["step"], 0)
        state = {name: (self.folder / name).read_bytes() for name in ("run.ckpt.h5", "run.h5.part")}
        for ranks in (3, 1, 8):
            with self.subTest(ranks=ranks):
                for name, content in state.items():
                    (self.folder / name).write_bytes(content)
                self.same_as_whole(ranks, *self.longer, "--resume", "auto", "--overwrite")
                self.assertEqual([name for name in self.files() if name.startswith("run.")], ["run.h5", "run.xdmf"])

    def test_checkpoint_does_not_tell_how_many_wrote_it(self):
        """Stopped at the same step, every column of the checkpoint is the same. Which step a signal meets is chance."""
        steps = {1: set(), 3: set()}
        for _ in range(20):
            for ranks in steps:
                code, err = self.stop_at_once(ranks, *self.arguments(f"r{ranks}.h5"), "--overwrite")
                self.assertEqual(code, STOPPED, err)
                with h5py.File(self.folder / f"r{ranks}.ckpt.h5", "r") as file:
                    step = int(file["granular/checkpoint"].attrs["step"])
                steps[ranks].add(step)
                (self.folder / f"r{ranks}.ckpt.h5").rename(self.folder / f"r{ranks}.{step}")
            if both := steps[1] & steps[3]:
                break
        self.assertTrue(both, f"never stopped at the same step: {steps}")
        step = both.pop()
        one, three = ({name: value for name, value in datasets(self.folder / f"r{ranks}.{step}").items()
                       if name.startswith("granular/checkpoint/") and "/trajectory/" not in name} for ranks in (1, 3))
        self.assertEqual(sorted(one), sorted(three))
        self.assertGreater(one["granular/checkpoint/contacts/pair"].size, 1000)
        for name in one:
            self.assertEqual(one[name].tobytes(), three[name].tobytes(), name)


class Corners(RankRuns):
    """Scenes that a cut into domains does not suit."""

    def prepare(self):
        pass

    def same_on(self, ranks, position, velocity, scene, radius=None):
        """Runs it on one rank and on `ranks`; returns the positions at all frames."""
        position = np.asarray(position, dtype=float)
        write_model(self.folder / "model.h5", position, radius or len(position) * [RADIUS], velocity=velocity)
        self.write("scene.json", {"output": {"frame_interval": "10ms", "float64": True,
                                             "fields": ["position", "velocity", "angular_velocity", "force"]},
                                  "bond": {"bond_pressure": 100, "bond_friction": 1, "bond_initiation_factor": 1.01},
                                  **scene})
        self.ok("dem-run", *self.arguments("one.h5", "model.h5"))
        for many in ranks:
            with self.subTest(ranks=many):
                self.ok("dem-run", *self.arguments("many.h5", "model.h5"), "--overwrite", wrapper=mpirun(many))
                self.assertSamePhysics("one.h5", "many.h5")
        with h5py.File(self.folder / "one.h5", "r") as file:
            change = np.ptp(file["particles/all/velocity/value"][:], axis=0)
            self.assertGreater(change.max(), 0.01, "nothing touches: the scene tests nothing")
            return file["particles/all/position/value"][:]

    def lattice(self, *counts, spacing=2.001 * RADIUS):
        """Grains on a lattice, a little off it, at random velocities: always the same."""
        random = np.random.default_rng(7)
        points = spacing * np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3)
        return (points + 5e-4 * RADIUS * random.uniform(-1, 1, points.shape),
                random.uniform(-0.3, 0.3, points.shape))

    def test_fewer_grains_than_ranks(self):
        d = 2 * RADIUS
        self.same_on((2, 8), [[0, 0, 0], [1.01 * d, 0, 0], [0, 3 * d, 0]], [[1, 0, 0], [0, 0, 0], [0, -1, 0]],
                     {"time": {"end": "0.1s"}, "gravity": [0, 0, 0]})

    def test_one_grain(self):
        self.same_on((3,), [[0, 0, 1.2 * RADIUS]], [[0.1, 0, 0]],
                     {"time": {"end": "0.1s"}, "walls": [{"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}]})

    def test_all_in_one_corner(self):
        position, velocity = self.lattice(7, 6, 5)
        box = {"lower": [0, 0, 0], "upper": [1000, 1000, 1000]}
        self.same_on((2, 4, 8), position + 2 * RADIUS, velocity,
                     {"time": {"end": "50ms"}, "gravity": [0, 0, 0], "box": box,
                      "walls": [{"plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}]})

    def test_thin_periodic_box(self):
        """Five grains across the box in the direction of the cuts, eight ranks: nearly everything is an image."""
        position, velocity = self.lattice(5, 3, 3)
        size = [2.001 * RADIUS * n for n in (5, 3, 3)]
        path = self.same_on((2, 8), position, velocity,
                            {"time": {"end": "0.1s"}, "gravity": [3, 0, 0],
                             "box": {"lower": [0, 0, 0], "upper": size, "periodic": [True, True, True]}})
        self.assertGreater(np.ptp(path[..., 0]), 0)

    def test_grain_through_every_domain(self):
        """A large one between two rows of small ones at rest, some of which are in its way."""
        rest = RADIUS * np.array([[4.2 * k, 4.5 * (-1) ** k, 0] for k in range(60)])
        rest[::9, 1] *= 3 / 4.5
        velocity = np.zeros((61, 3))
        velocity[0] = [20, 0, 0]
        path = self.same_on((3, 8), np.concatenate([[[-6 * RADIUS, 0, 0]], rest]), velocity,
                            {"time": {"end": "0.2s"}, "gravity": [0, 0, 0],
                             "material": {"density": 1000, "friction": 0, "restitution": 0.9}},
                            radius=[3 * RADIUS] + 60 * [RADIUS])
        self.assertGreater(path[-1, 0, 0], rest[-1, 0], "the runner is through")
        moved = np.linalg.norm(path[-1, 1:] - rest, axis=1) > RADIUS
        self.assertGreater(moved[:30].sum(), 1)
        self.assertGreater(moved[30:].sum(), 1)


class OneVoice(RankRuns):
    """What a user sees of several ranks is what he sees of one."""

    def prepare(self):
        write_model(self.folder / "slope.h5", [[0, 0, 0], [3 * RADIUS, 0, 0]], [RADIUS, RADIUS])
        self.write("scene.json", {"time": {"end": "10ms"}})

    def test_bad_configuration(self):
        self.write("scene.json", {"time": {"end": "10 parsecs"}})
        for ranks in (2, 4):
            got = self.run_tool("dem-run", *self.arguments(), wrapper=mpirun(ranks))
            self.assertEqual(got.code, CONFIGURATION, str(got))
            self.assertEqual(len(got.err.splitlines()), 1, str(got))
            self.assertIn("10 parsecs", got.err)

    def test_missing_model(self):
        self.fails(INPUT, "dem-run", *self.arguments(model="absent.h5"), wrapper=mpirun(4), names="absent.h5")

    def test_damaged_model(self):
        """Found by the ranks together while they read, not before."""
        content = (self.folder / "slope.h5").read_bytes()
        (self.folder / "slope.h5").write_bytes(content[:len(content) // 2])
        self.fails(INPUT, "dem-run", *self.arguments(), wrapper=mpirun(3), names="slope.h5")

    def test_existing_output(self):
        self.write("run.h5", "mine")
        self.fails(EXISTS, "dem-run", *self.arguments(), wrapper=mpirun(4), names="run.h5")
        self.assertEqual((self.folder / "run.h5").read_text(), "mine")

    def test_dry_run(self):
        got = self.ok("dem-run", *self.arguments(), "--dry-run", "--format", "json", wrapper=mpirun(3))
        self.assertEqual(got.json["ranks"], 3)  # twice the result would be no JSON
        self.assertGreater(got.json["steps"], 0)
        self.assertNotIn("run.h5", self.files())

    def test_version_and_help(self):
        for switch in ("--version", "--help"):
            alone, many = (self.ok("dem-run", switch, wrapper=mpirun(ranks)) for ranks in (1, 4))
            self.assertGreater(len(alone.out), 20)
            self.assertEqual(many.out, alone.out)

    def test_result(self):
        got = self.run_tool("dem-run", *self.arguments(), "--format", "json", wrapper=mpirun(2))
        self.assertEqual(got.code, DONE, str(got))
        self.assertEqual((got.json["ranks"], got.json["particle_count"]), (2, 2))


if __name__ == "__main__":
    main()
