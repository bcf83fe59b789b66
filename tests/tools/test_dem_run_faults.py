# SPDX-License-Identifier: GPL-3.0-or-later
"""dem-run when things go wrong under it: kills, full disks, damaged files, signals to launchers. Whatever happened, the
run goes on from what is there and ends as if nothing had been, or says what to do.

LongFaults repeats the kills a hundred times; it runs where TALUS_LONG is set in the environment.
"""
import os
import pathlib
import random
import shutil
import signal
import subprocess
import time
import unittest

import h5py

from rank_runs import RankRuns, mpirun
from talus_tools import BIN, DONE, FAILED, INPUT, ROOT, STOPPED, copy_with, datasets, flip_byte, main, words

STATE = ("run.ckpt.h5", "run.ckpt.h5.prev", "run.h5", "run.h5.part")


def alive(pid):
    """Whether a process runs: one that only waits for its parent to take note of its end does not."""
    try:
        return pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


class Faults(RankRuns):
    """The small slide with a step so short that it takes a second or two."""

    def prepare(self):
        self.make_slope("slope.h5")
        self.write_slide(self.fraction_for(1.2))
        self.ok("dem-run", *self.arguments("whole.h5"))

    def resumed(self, *more, interval="0.05s"):
        return [*self.arguments(), "--resume", "auto", "--overwrite", "--checkpoint-interval", interval, *more]

    def loud(self, *more):
        """The same with its warnings."""
        return [word for word in self.resumed(*more) if word != "-q"] + ["--progress", "none"]

    def ends_like_the_whole(self, ranks=1):
        self.ok("dem-run", *self.resumed(), wrapper=mpirun(ranks))
        self.assertFinished()

    def assertFinished(self):
        self.assertSamePhysics("run.h5", "whole.h5")
        self.assertEqual([name for name in self.files() if name.startswith("run.")], ["run.h5", "run.xdmf"],
                         "nothing is missing, and nothing of the interruption stays behind")

    def wait_for(self, name, process):
        while not (self.folder / name).exists():
            self.assertIsNone(process.poll(), f"ended before there was {name}: {self.files()}")
            time.sleep(0.001)

    def end_of(self, process, ranks, where=""):
        """Waits until no rank of a run lives any more, and for its launcher, which does not wait for ranks that it
        kills; returns the exit code. About once in 300 kills Open MPI's launcher (4.1.4) locks itself up at its end
        (in PMIx_server_finalize): it is killed then, the ranks being gone by that time."""
        for _ in range(12000):
            if not any(alive(pid) for pid in ranks if pid != process.pid):
                break
            time.sleep(0.01)
        else:
            self.fail(f"{where}ranks wait for one that was killed: {ranks}")
        try:
            return process.wait(20 if process.pid not in ranks else 120)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait(20)

    def kill_when_there_is(self, name):
        """A run that is killed once this file is there."""
        process = self.start(1, *self.resumed())
        self.wait_for(name, process)
        process.kill()
        process.wait(60)
        self.assertIn(name, self.files())

    def stopped_early(self, ranks=1):
        """A run that has stopped with a checkpoint, most of it still to do."""
        code, err = self.stop_at_once(ranks, *self.resumed())
        self.assertEqual(code, STOPPED, err)


class Kills(Faults):
    def kill_again_and_again(self, kills, choose_ranks, seed):
        """Kills a run, or one rank of it, at random moments and takes it up again; where one ends before its turn it
        must equal the whole, and another begins."""
        chance = random.Random(seed)
        killed = finished = 0
        told = f"seed {seed}: "
        while killed < kills:
            ranks = choose_ranks(chance)
            process = self.start(ranks, *self.resumed())
            found = self.ranks_of(process, ranks)
            time.sleep(chance.uniform(0, 0.8 if ranks == 1 else 1.5))
            try:
                os.kill(chance.choice(found), signal.SIGKILL)
            except (ProcessLookupError, IndexError):
                pass  # ended already
            code = self.end_of(process, found, f"{told}kill {killed}: ")
            err = process.stderr.read()
            where = f"{told}kill {killed} of {ranks} ranks: exit {code}: {err}"
            if ranks == 1:
                self.assertIn(code, (DONE, -signal.SIGKILL), where)
            self.assertNotIn("dem-run: ", err, where)  # mpirun's code varies: it may itself die of a broken pipe
            with self.subTest(f"{told}after kill {killed} of {ranks} ranks"):
                self.assertWhole("run.ckpt.h5", "run.ckpt.h5.prev", "run.h5")
            if code == DONE:
                finished += 1
                with self.subTest(f"{told}end {finished}"):
                    self.assertFinished()
                for left in self.folder.glob("run.*"):
                    left.unlink()
            else:
                killed += 1
        with self.subTest(f"{told}the last one's end"):
            self.ends_like_the_whole()


class KillsAlone(Kills):
    def test_killed_again_and_again(self):
        self.kill_again_and_again(12, lambda chance: 1, seed=1)


class KillsOfRanks(Kills):
    def test_one_rank_killed_again_and_again(self):
        self.kill_again_and_again(6, lambda chance: chance.choice((2, 2, 3)), seed=2)

    def test_one_rank_killed_resumed_alone(self):
        process = self.start(2, *self.resumed())
        self.wait_for("run.ckpt.h5", process)
        found = self.ranks_of(process, 2)
        os.kill(found[1], signal.SIGKILL)
        self.assertNotEqual(self.end_of(process, found), DONE)
        self.assertWhole("run.ckpt.h5", "run.ckpt.h5.prev")
        self.assertNotIn("run.h5", self.files())
        self.ends_like_the_whole(1)


class FullDisk(Faults):
    """The state of a run that was stopped lies on a disk with little room left, where it goes on."""

    def goes_on_without_room(self, ranks, room, interval, *more):
        """Leaves what is then on the disk in the folder. `room`: kilobytes, or those of so many checkpoints."""
        self.stopped_early()
        seed = self.folder / "seed"
        seed.mkdir()
        for name in ("run.ckpt.h5", "run.h5.part"):
            (self.folder / name).rename(seed / name)
        if isinstance(room, float):
            room = int(room * (seed / "run.ckpt.h5").stat().st_size / 1024)
        used = sum(-(-path.stat().st_size // 4096) * 4 for path in seed.iterdir())
        script = 'cp seed/* disk/ && cd disk && "$@"; code=$?; cp -p * ..; exit $code'
        wrapper = [*self.small_disk(used + room), "/bin/sh", "-c", script, "sh", *mpirun(ranks)]
        arguments = ["../slope.h5", "-c", "../scene.json", *self.resumed(*more, interval=interval)[3:]]
        got = self.run_tool("dem-run", *arguments, wrapper=wrapper)
        self.assertEqual(got.code, FAILED, str(got))
        lines = got.err.splitlines()
        self.assertEqual(len(lines), 1, str(got))
        self.assertIn("No space left", lines[0])
        self.assertWhole("run.ckpt.h5", "run.ckpt.h5.prev")
        self.assertIn("run.h5.part", self.files())
        self.assertNotIn("run.h5", self.files())
        return lines[0]

    def full_during_a_checkpoint(self, ranks):
        # Nothing but the checkpoint is written: no frame, no row of the series, no other stage comes before it.
        line = self.goes_on_without_room(ranks, 0.6, "0.05s", "--set", 'stages=[{"name": "settle", "end": 1000}]',
                                         "--output.frame_interval", 1000, "--output.series_interval", 1000)
        self.assertTrue(line.startswith("dem-run: error: run.ckpt.h5: "), line)
        self.assertEqual((self.folder / "run.ckpt.h5").read_bytes(), (self.folder / "seed/run.ckpt.h5").read_bytes())
        self.ends_like_the_whole()

    def full_during_a_frame(self, ranks):
        line = self.goes_on_without_room(ranks, 40, "1h")
        self.assertTrue(line.startswith("dem-run: error: run.h5: "), line)
        self.ends_like_the_whole()

    def test_checkpoint(self):
        self.full_during_a_checkpoint(1)

    def test_checkpoint_of_ranks(self):
        self.full_during_a_checkpoint(2)

    def test_frame(self):
        self.full_during_a_frame(1)

    def test_frame_of_ranks(self):
        self.full_during_a_frame(2)


class DamagedFiles(Faults):
    def falls_back(self, damage):
        """A run that was killed with two checkpoints; the newer one is damaged then."""
        self.kill_when_there_is("run.ckpt.h5.prev")
        newest, previous = self.folder / "run.ckpt.h5", self.folder / "run.ckpt.h5.prev"
        damage(newest)
        good = previous.read_bytes()
        got = self.run_tool("dem-run", *self.loud("--max-wall", "0.2s"))
        self.assertEqual(got.code, STOPPED, str(got))
        warnings = [line for line in got.err.splitlines() if "warning" in line]
        self.assertEqual(warnings,
                         ["dem-run: warning: run.ckpt.h5: damaged, going on from run.ckpt.h5.prev"], str(got))
        self.assertWhole("run.ckpt.h5", "run.ckpt.h5.prev")
        self.assertEqual(previous.read_bytes(), good, "the damaged one does not take the good one's place")
        self.ends_like_the_whole()

    def test_truncated_checkpoint(self):
        self.falls_back(lambda path: os.truncate(path, path.stat().st_size // 2))

    def test_bit_of_the_checkpoint_flipped(self):
        self.falls_back(lambda path: flip_byte(path, path, "granular/checkpoint/particles/position"))

    def test_both_damaged(self):
        """Then it starts from the beginning and says so."""
        self.kill_when_there_is("run.ckpt.h5.prev")
        for name in ("run.ckpt.h5", "run.ckpt.h5.prev"):
            os.truncate(self.folder / name, 5000)
        got = self.ok("dem-run", *self.loud())
        self.assertIn("run.ckpt.h5: the checkpoint is damaged", got.err)
        self.assertSamePhysics("run.h5", "whole.h5")

    def refused(self, *says):
        """The trajectory's unfinished file cannot be gone on with; it is left as it is, and the cure is named."""
        before = {name: (self.folder / name).read_bytes() for name in STATE if (self.folder / name).exists()}
        for ranks in (1, 2):
            self.fails(INPUT, "dem-run", *self.resumed(), wrapper=mpirun(ranks),
                       names=["run.h5.part", "put back the file of the run that wrote the checkpoint", *says])
        for name, content in before.items():
            self.assertEqual((self.folder / name).read_bytes(), content, name)

    def test_trajectory_of_another_run(self):
        def push(file):
            file["particles/all/velocity"] = 0 * file["particles/all/position"][:] + 0.1

        self.make_slope("explicit.h5", "--explicit")
        copy_with(self.folder / "explicit.h5", self.folder / "pushed.h5", push)
        process = self.start(1, *self.arguments("other.h5", "pushed.h5"), "--checkpoint-interval", "0.05s")
        self.wait_for("other.ckpt.h5.prev", process)  # longer than the one it takes the place of
        process.kill()
        process.wait(60)
        self.stopped_early()
        own = (self.folder / "run.h5.part").read_bytes()
        (self.folder / "other.h5.part").replace(self.folder / "run.h5.part")
        self.refused()
        (self.folder / "run.h5.part").write_bytes(own)
        self.ends_like_the_whole()

    def test_truncated_trajectory(self):
        self.stopped_early()
        part = self.folder / "run.h5.part"
        own = part.read_bytes()
        os.truncate(part, len(own) // 2)
        self.refused(len(own))
        part.write_bytes(own)
        self.ends_like_the_whole()

    def test_torn_trajectory(self):
        """What a kill or a power cut leaves half written comes back from the checkpoint."""
        self.kill_when_there_is("run.ckpt.h5")
        with open(self.folder / "run.h5.part", "r+b") as file:
            file.write(bytes(512))  # the superblock and what follows
            file.seek(0, os.SEEK_END)
            file.write(b"torn" * 1000)
        self.ends_like_the_whole()

    def test_checkpoint_that_was_being_written(self):
        """What a kill leaves of it goes with the checkpoints, also where no other is written before the end."""
        self.stopped_early()
        for name in ("run.ckpt.h5.part", "run.ckpt.h5.prev.part"):
            self.write(name, "half")
        self.ok("dem-run", *self.resumed(interval="1h"))
        self.assertFinished()

    def test_missing_trajectory(self):
        """The rest is computed, and a line says that the frames before are gone."""
        self.stopped_early()
        (self.folder / "run.h5.part").unlink()
        got = self.ok("dem-run", *self.loud())
        self.assertIn("run.h5: the frames before the checkpoint are gone", got.err)
        with h5py.File(self.folder / "run.h5") as rest, h5py.File(self.folder / "whole.h5") as whole:
            position = "particles/all/position/value"
            self.assertEqual(rest[position][-1].tobytes(), whole[position][-1].tobytes())

    def test_frame_of_the_trajectory_damaged(self):
        """A frame is not read again by the run; whoever reads it hears of it from the checksum."""
        self.kill_when_there_is("run.ckpt.h5")
        with h5py.File(self.folder / "run.ckpt.h5", "r") as file:
            ranges = file["granular/checkpoint/trajectory/ranges"][:].reshape(-1, 2)
        image = [(int(start), int(start + size)) for start, size in ranges]
        gap = max(zip(image, image[1:]), key=lambda pair: pair[1][0] - pair[0][1])  # of which there is no image
        with open(self.folder / "run.h5.part", "r+b") as file:
            file.seek((gap[0][1] + gap[1][0]) // 2)
            byte = file.read(1)
            file.seek(-1, os.SEEK_CUR)
            file.write(bytes([byte[0] ^ 1]))
        self.ok("dem-run", *self.resumed())
        with self.assertRaises(OSError):
            datasets(self.folder / "run.h5")


class Launchers(Faults):
    def run_ranks(self, ranks):
        return [ROOT / "pipelines" / "run-ranks", ranks]

    def test_max_wall_under_mpirun(self):
        got = self.run_tool("dem-run", *self.resumed("--max-wall", "0.2s"), wrapper=mpirun(2))
        self.assertEqual(got.code, STOPPED, str(got))
        self.assertWhole("run.ckpt.h5")
        self.ends_like_the_whole(3)

    def test_user_signal_to_mpirun(self):
        self.stop_launcher(mpirun(2), signal.SIGUSR1)

    def test_terminate_run_ranks(self):
        self.stop_launcher(self.run_ranks(2), signal.SIGTERM)

    def test_interrupt_run_ranks(self):
        self.stop_launcher(self.run_ranks(2), signal.SIGINT)

    def test_terminate_run_ranks_with_one(self):
        self.stop_launcher(self.run_ranks(1), signal.SIGTERM)

    def stop_launcher(self, launcher, number):
        """A signal to the launcher once there is a checkpoint: the run stops with another one and goes on later."""
        process = self.start(2, *self.resumed(), launcher=launcher)
        self.wait_for("run.ckpt.h5", process)
        process.send_signal(number)
        code = process.wait(120)
        err = process.stderr.read()
        self.assertEqual(code, STOPPED, err)
        self.assertEqual(err.count("--resume auto"), 1, err)
        self.assertIn("run.h5.part", self.files())
        self.assertNotIn("run.h5", self.files())
        self.assertWhole("run.ckpt.h5", "run.ckpt.h5.prev")
        self.ends_like_the_whole(2)

    def test_run_ranks_hands_on_the_exit_code(self):
        for ranks in (1, 2):
            for code in (0, 4):
                got = subprocess.run(words(*self.run_ranks(ranks), "sh", "-c", f"exit {code}"), capture_output=True)
                self.assertEqual(got.returncode, code, got.stderr)
        for wrong in (["0", "true"], ["two", "true"], ["2"], []):
            got = subprocess.run(words(ROOT / "pipelines" / "run-ranks", *wrong), capture_output=True, text=True)
            self.assertEqual(got.returncode, 2, wrong)
            self.assertIn("usage", got.stderr)

    def test_run_ranks_starts_so_many(self):
        for ranks in (1, 2, 5):
            got = subprocess.run(words(*self.run_ranks(ranks), "echo", "here"), capture_output=True, text=True)
            self.assertEqual(got.stdout, "here\n" * ranks, got.stderr)


class Make(Faults):
    """The project's own slide.mk, with files and a scene of this test."""

    def setUp(self):
        super().setUp()
        pipelines = self.folder / "pipelines"
        (pipelines / "scenes").mkdir(parents=True)
        (pipelines / "run-ranks").symlink_to(ROOT / "pipelines" / "run-ranks")
        shutil.copy(self.folder / "scene.json", pipelines / "scenes" / "slide.json")
        shutil.copy(self.folder / "slope.h5", self.folder / "slope.model.h5")
        self.write("Makefile", f".DELETE_ON_ERROR:\n.SUFFIXES:\nbin := {BIN}\ninclude {ROOT}/pipelines/slide.mk\n")
        (self.folder / "whole.h5").rename(self.folder / "whole")

    def make(self, *more):
        """`make` for the trajectory, with a slope that is taken as it is."""
        command = ["make", "-o", "slope.model.h5", "slope=slope", "slide=slide", "JOBS=1", *more, "slide.traj.h5"]
        return subprocess.run(words(*command), cwd=self.folder, capture_output=True, text=True, timeout=300,
                              env={name: value for name, value in os.environ.items() if not name.startswith("MAKE")})

    def stopped_and_made_again(self, first, second):
        got = self.make("MAX_WALL=0.2s", f"RANKS={first}")
        self.assertEqual(got.returncode, 2, got.stderr)
        self.assertIn(f"Error {STOPPED}", got.stderr)
        self.assertNotIn("slide.traj.h5", self.files())
        self.assertIn("slide.ckpt.h5", self.files())
        self.assertWhole("slide.ckpt.h5")
        got = self.make(f"RANKS={second}")
        self.assertEqual(got.returncode, 0, got.stderr)
        self.assertSamePhysics("slide.traj.h5", "whole")
        self.assertFalse([name for name in self.files() if "ckpt" in name or "part" in name])
        got = self.make("-q")
        self.assertEqual(got.returncode, 0, "a second time there is nothing to do")

    def test_alone(self):
        self.stopped_and_made_again(1, 1)

    def test_ranks(self):
        self.stopped_and_made_again(2, 1)

    def test_finished_trajectory_is_not_deleted(self):
        """By .DELETE_ON_ERROR, where dem-run fails after it: here its result cannot be printed."""
        (self.folder / "slide.run.json.part").symlink_to("/dev/full")
        got = self.make()
        self.assertNotEqual(got.returncode, 0)
        self.assertIn("slide.traj.h5", self.files(), got.stderr)
        self.assertSamePhysics("slide.traj.h5", "whole")

    def test_threads_are_shared_out(self):
        for jobs, ranks, threads in ((4, 1, 4), (8, 2, 4), (5, 2, 2), (1, 3, 1)):
            got = self.make("-n", f"JOBS={jobs}", f"RANKS={ranks}")
            self.assertIn(f"run-ranks {ranks} ", got.stdout)
            self.assertIn(f" -j {threads} ", got.stdout)


@unittest.skipUnless(os.environ.get("TALUS_LONG"), "TALUS_LONG is not set")
class LongFaults(Kills):
    def test_alone(self):
        self.kill_again_and_again(100, lambda chance: 1, seed=3)

    def test_ranks(self):
        self.kill_again_and_again(100, lambda chance: chance.choice((1, 2, 3, 4)), seed=4)


if __name__ == "__main__":
    main()
