# SPDX-License-Identifier: GPL-3.0-or-later
"""The tests of a series in their order, and the options that say which: for table4 and triaxial-task."""
import argparse

from boxes import PUBLISHED
from triaxial_tests import FRICTION, Bench, common_options, quantity, words_of


def parser_of(description, epilog=None):
    parser = argparse.ArgumentParser(description=description, epilog=epilog,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    common_options(parser, "results/table4")
    parser.add_argument("--ratios", type=words_of(float), default=[25.0], help="D/d, diameters of specimen and grains")
    parser.add_argument("--stresses", type=words_of(quantity("kPa", "Pa", "MPa")), default=[0.0, 100.0, 200.0],
                        help="confining stresses, kPa")
    parser.add_argument("--seeds", type=words_of(int), default=[1], help="of the boxes: each a repeat of every test")
    parser.add_argument("--groups", type=words_of(str), default=["PL", "PF"],
                        help="PL: boxes made without friction, PF: with 0.4, FF: fallen into place without boxes")
    parser.add_argument("--levels", type=words_of(int), default=[2], help="of the boxes, 1 (finest) to 4")
    return parser


def checked_options(parser):
    o = parser.parse_args()
    if not o.groups or not set(o.groups) <= set(FRICTION):
        parser.error(f"--groups: found {' '.join(o.groups)}, expected some of {' '.join(FRICTION)}")
    if not o.levels or not set(o.levels) <= set(PUBLISHED):
        parser.error("--levels: expected some of 1 2 3 4")
    if not o.ratios or min(o.ratios) < 5:
        parser.error("--ratios: expected numbers from 5: a membrane needs some grains across")
    if not o.stresses or min(o.stresses) < 0:
        parser.error("--stresses: expected numbers from 0")
    if not o.seeds:
        parser.error("--seeds: expected some numbers")
    return o


def bench_of(o):
    return Bench(o.bin, o.out, o.scene, o.set, o.jobs, o.max_wall)


def units(o):
    """What is to be done, in the order of the tasks' numbers: (group, level, ratio, seed, stress in Pa). Free fall knows
    no level: 0."""
    return [(group, level, ratio, seed, 1e3 * stress) for group in o.groups
            for level in ([0] if group == "FF" else o.levels) for ratio in o.ratios for seed in o.seeds
            for stress in o.stresses]


def test_of(bench, unit):
    group, level, ratio, seed, stress = unit
    return bench.test(bench.specimen(group, level, ratio, seed), stress)
