// SPDX-License-Identifier: GPL-3.0-or-later
#include "samples.hpp"

#include "io/atomic_file.hpp"
#include "io/quick_check.hpp"

namespace talus::io::test {
namespace {

/// Files by and for other programs: h5py writes the smallest models and reads ours back.
class OtherPrograms : public FileTest {
protected:
    void SetUp() override {
        FileTest::SetUp();
        if (std::system("/usr/bin/python3 -c 'import h5py, numpy' 2>/dev/null") != 0)
            GTEST_SKIP() << "h5py is not installed (package python3-h5py)";
    }
    /// Runs a script with `h5py`, `np` and the folder as `at`; its assertions must hold.
    void python(const std::string& script) const {
        put_bytes(path("script.py"), "import sys, h5py, numpy as np\nat = sys.argv[1] + '/'\n" + script);
        const std::string command = "/usr/bin/python3 '" + path("script.py") + "' '" + folder.string() + "'";
        EXPECT_EQ(std::system(command.c_str()), 0) << script;
    }
    Grains model() const { return std::get<Grains>(read_model(path("m.h5")).model); }
    void expect_refused(const std::vector<std::string>& words) const {
        expect_error(ExitCode::input_invalid, words, [&] { read_model(path("m.h5")); });
    }
};

/// The start of a two-particle model; `f` is the file.
const std::string two = R"(
f = h5py.File(at + 'm.h5', 'w')
g = f.create_group('granular'); g.attrs['kind'] = 'model'; g.attrs['complete'] = 1
p = f.create_group('particles/all')
p['position'] = np.array([[0, 0, 0.5], [0, 0, 1.75]])
p['radius'] = np.array([0.5, 0.75])
)";

TEST_F(OtherPrograms, smallest_model) {
    python(two);
    EXPECT_EQ(kind_of(path("m.h5")), FileKind::model);
    const Grains grains = model();
    EXPECT_EQ(grains.position, (std::vector<Vec3>{{0, 0, 0.5}, {0, 0, 1.75}}));
    EXPECT_EQ(grains.radius, (std::vector<double>{0.5, 0.75}));
    EXPECT_TRUE(grains.mass.empty() && grains.species.empty() && grains.contacts.pair.empty() && !grains.box);
}

TEST_F(OtherPrograms, one_particle_in_f32) {
    python(R"(
f = h5py.File(at + 'm.h5', 'w')
f.create_group('granular').attrs.update({'kind': 'model', 'complete': np.int8(1)})
f['particles/all/position'] = np.zeros((1, 3), 'f4') + 0.5
f['particles/all/radius'] = np.ones(1, 'f4')
)");
    EXPECT_EQ(model().position, (std::vector<Vec3>{{0.5, 0.5, 0.5}}));
}

TEST_F(OtherPrograms, ways_to_write_kind_and_complete) {
    for (const char* way :
         {"g.attrs['kind'] = np.string_('model'); g.attrs['complete'] = True",
          "g.attrs['kind'] = np.array('model', dtype='S12'); g.attrs['complete'] = np.array([1])",
          "g.attrs.create('kind', 'model', dtype=h5py.string_dtype('utf-8', 5)); g.attrs['complete'] = 1.0",
          "g.attrs.create('kind', ['model'], dtype=h5py.string_dtype()); g.attrs['complete'] = "
          "np.bool_(True)",
          "del g.attrs['kind'], g.attrs['complete']; g['kind'] = 'model'; g['complete'] = 1"}) {
        python(two + way + "\n");
        EXPECT_EQ(model().size(), 2u) << way;
    }
    python(two + "g.attrs['complete'] = False\n");
    expect_refused({"m.h5", "complete is not 1"});
    python(two + "del g.attrs['complete']\n");
    expect_refused({"m.h5", "complete is not 1"});
    python(two + "g.attrs['kind'] = 'modle'\n");
    expect_refused({"m.h5", "\"modle\""});
    python(two + "del f['granular']\n");
    expect_refused({"m.h5", "/granular", "missing"});
}

TEST_F(OtherPrograms, time_dependent_elements_give_their_last_frame) {
    python(two + R"(
del p['position']
for name, last in (('position', 7.0), ('velocity', 9.0)):
    e = p.create_group(name)
    e['step'] = [0, 1]; e['time'] = [0.0, 0.1]
    v = np.zeros((2, 2, 3)); v[1] = last
    e['value'] = v
)");
    EXPECT_EQ(model().position, (std::vector<Vec3>(2, {7, 7, 7})));
    EXPECT_EQ(model().velocity, (std::vector<Vec3>(2, {9, 9, 9})));
    python(two + R"(
e = p.create_group('material')
e['step'] = [0, 1]; e['time'] = [0.0, 0.1]
e['value'] = np.array([[3, 3], [0, 255]])
)");
    EXPECT_EQ(model().material, (std::vector<std::uint8_t>{0, 255}));
}

TEST_F(OtherPrograms, optional_columns_and_contacts) {
    python(two + R"(
p['velocity'] = np.array([[0, 0, 1], [0, 0, -1]])
p['angular_velocity'] = np.zeros((2, 3), 'i4')
p['mass'] = np.array([1.0, 2.0]); p['species'] = np.array([1, 0])
p['material'] = np.array([0, 1], 'i8')
f['connectivity/contacts'] = np.array([[0, 1]])
b = p.create_group('box'); b.attrs['dimension'] = 3; b.attrs['boundary'] = ['periodic', 'none', 'none']
b['edges'] = [3.0, 4.0, 5.0]
)");
    const Grains grains = model();
    EXPECT_EQ(grains.velocity[1], (Vec3{0, 0, -1}));
    EXPECT_EQ(grains.species, (std::vector<Species>{Species::fixed, Species::grain}));
    EXPECT_EQ(grains.material, (std::vector<std::uint8_t>{0, 1}));
    ASSERT_EQ(grains.contacts.size(), 1u);
    EXPECT_EQ(grains.contacts.normal_overlap[0], 0.0); // 0.5 + 0.75 - 1.25, measured
    EXPECT_EQ(grains.contacts.image[0], (std::array<std::int8_t, 3>{0, 0, 0}));
    EXPECT_EQ(grains.box, (Box{{0, 0, 0}, {3, 4, 5}, {true, false, false}}));
}

TEST_F(OtherPrograms, invalid_models) {
    const std::vector<std::pair<std::string, std::vector<std::string>>> cases = {
        {"p['position'][1, 2] = np.nan", {"/particles/all/position", "row 1", "not finite"}},
        {"p['position'][0, 0] = np.inf", {"/particles/all/position", "row 0", "not finite"}},
        {"p['radius'][1] = np.nan", {"/particles/all/radius", "row 1"}},
        {"p['radius'][0] = -0.5", {"/particles/all/radius", "row 0", "-0.5"}},
        {"p['radius'][0] = 0", {"/particles/all/radius", "row 0"}},
        {"del p['radius']", {"/particles/all/radius", "missing"}},
        {"del p['position']", {"/particles/all/position", "missing"}},
        {"del f['particles']", {"/particles/all", "missing"}},
        {"del p['radius']; p['radius'] = [1.0, 1.0, 1.0]", {"/particles/all/radius", "3 rows", "2"}},
        {"del p['position']; p['position'] = np.zeros((2, 2))",
         {"/particles/all/position", "[2][2]", "[N][3]"}},
        {"del p['position']; p['position'] = np.zeros(6)", {"/particles/all/position", "[6]"}},
        {"del p['position'], p['radius']; p['position'] = np.zeros((0, 3)); p['radius'] = np.zeros(0)",
         {"no particle"}},
        {"del p['position']; p['position'] = ['a', 'b']", {"/particles/all/position"}},
        {"del p['position']; p['position/value'] = np.zeros((0, 2, 3))",
         {"/particles/all/position/value", "no frame"}},
        {"p['mass'] = [1.0, 0.0]", {"/particles/all/mass", "row 1"}},
        {"p['velocity'] = np.full((2, 3), np.inf)", {"/particles/all/velocity", "row 0"}},
        {"p['velocity'] = np.zeros((1, 3))", {"/particles/all/velocity", "1 rows"}},
        {"p['species'] = [0, 3]", {"/particles/all/species", "row 1", "3"}},
        {"p['material'] = [0, 256]", {"/particles/all/material", "row 1", "256", "0 to 255"}},
        {"p['material'] = [-1, 0]", {"/particles/all/material", "row 0", "-1"}},
        {"p['material'] = [0, 1, 0]", {"/particles/all/material", "3 rows", "2"}},
        {"f['connectivity/contacts'] = [[1, 0]]", {"/connectivity/contacts", "contact 0"}},
        {"f['connectivity/contacts'] = [[0, 2]]", {"/connectivity/contacts", "0 <= i < j < 2"}},
        {"f['connectivity/contacts'] = [[0, 1]]; f['granular/contacts/image'] = np.zeros((2, 3), 'i1')",
         {"/granular/contacts/image", "2 rows"}},
    };
    for (const auto& [change, words] : cases) {
        python(two + change + "\n");
        std::vector<std::string> all = words;
        all.push_back("m.h5");
        SCOPED_TRACE(change);
        expect_refused(all);
    }
}

TEST_F(OtherPrograms, h5py_reads_ours) {
    write_pgbox(path("a.pgbox.h5"), sample_pgbox(), false);
    write_model(path("a.model.h5"), {sample_grains(), sample_provenance(), "{}"}, false);
    write_model(path("t.model.h5"), {sample_tiled(), {}, ""}, false);
    write_checkpoint(path("a.ckpt.h5"), sample_checkpoint());
    TrajectoryWriter writer(path("a.traj.h5"), sample_statics(), {}, "", false);
    write_frames(writer, 30, 3);
    writer.finish();
    python(R"(
files = {n: h5py.File(at + n, 'r') for n in ('a.pgbox.h5', 'a.model.h5', 't.model.h5', 'a.ckpt.h5', 'a.traj.h5')}
for name, f in files.items():
    assert list(f['h5md'].attrs['version']) == [1, 1], name
    assert f['h5md/modules/units'].attrs['system'] == b'SI' and 'granular' in f['h5md/modules'], name
    assert f['granular'].attrs['complete'] == 1 and f['granular'].attrs['kind'].decode() in ('pgbox', 'model', 'checkpoint', 'trajectory')
    def visit(path, item):
        for a in item.attrs.values():
            assert not (isinstance(a, str)), path                     # fixed-length strings only
        if isinstance(item, h5py.Dataset):
            assert item.dtype.kind in 'fiuS' and item.dtype.fields is None, path
            assert item.fletcher32 or item.id.get_create_plist().get_layout() == h5py.h5d.COMPACT, path
    f.visititems(visit)
b = files['a.pgbox.h5']
assert b['particles/all/position'].shape == (50, 3) and b['particles/all/position'].attrs['unit'] == b'm'
assert b['particles/all/mass'].attrs['unit'] == b'kg' and b['connectivity/contacts'].dtype == '<i8'
assert np.allclose(b['particles/all/mass'][:], 4/3*np.pi*b['particles/all/radius'][:]**3*2400)
assert b[b['connectivity/contacts'].attrs['particles_group']].name == '/particles/all'
assert b['granular/contacts/image'].dtype == 'i1' and list(b['particles/all/box'].attrs['boundary']) == [b'periodic'] * 3
assert list(b['particles/all/box/edges'][:]) == [1.25] * 3 and b['granular/provenance/0001'].attrs['program'] == b'tile-trim'
assert b['granular/provenance/0001/seed'][0] == 2**64 - 1 and b['parameters/config'][()] == b'{"box_length": 1.25}'
t = files['t.model.h5']['granular/tiling']
assert t['index'].dtype == '<i4' and t['box'].dtype == 'u1' and t['kept'].dtype == '<u4' and t['first_particle'].dtype == '<u8'
j = files['a.traj.h5']['particles/all']
assert j['position/value'].dtype == '<f4' and j['position/value'].chunks == (1, 30, 3)
assert j['velocity/value'].attrs['unit'] == b'm s-1' and j['position/time'].attrs['unit'] == b's'
assert list(j['position'].attrs['origin']) == [562000.25, 5117000.5, 1500]
for other in ('velocity', 'box/edges'):
    for shared in ('step', 'time'):
        assert j[other][shared] == j['position'][shared]               # the same object, hard-linked
assert j['box/edges/value'].shape == (3, 3)
assert files['a.traj.h5']['granular/series/walls/floor/force_z'].attrs['unit'] == b'N'
)");
}

TEST_F(OtherPrograms, references_of_the_sidecars_hold) {
    write_model(path("a.model.h5"), {sample_grains(), sample_provenance(), "{}"}, false);
    write_model(path("t.model.h5"), {sample_tiled(), {}, ""}, false);
    TrajectoryWriter writer(path("a & b.traj.h5"), sample_statics(), {}, "", false);
    write_frames(writer, 30, 3);
    writer.finish();
    EXPECT_EQ(sidecar_path("x/a.traj.h5"), "x/a.traj.xdmf");
    python(R"(
import xml.etree.ElementTree as ET
kinds = {'Float': 'f', 'UChar': 'u', 'UInt': 'u', 'Int': 'i'}
def dims(item): return tuple(int(d) for d in item.get('Dimensions').split())
def data(item):
    if item.get('ItemType') == 'HyperSlab':
        slab, source = list(item)
        start, stride, count = np.array(slab.text.split(), int).reshape(dims(slab))
        assert (stride == 1).all()
        values = data(source)[tuple(slice(s, s + c) for s, c in zip(start, count))]
        return values.reshape(dims(item))
    file, path = item.text.strip().split(':')
    d = h5py.File(at + file, 'r')[path]
    assert d.shape == dims(item) and d.dtype.kind == kinds[item.get('NumberType')] and d.dtype.itemsize == int(item.get('Precision')), path
    return d[()]
seen = {}
for name, n in (('a.model', 40), ('t.model', 3), ('a & b.traj', 30)):
    grids = [g for g in ET.parse(at + name + '.xdmf').iter('Grid') if g.get('GridType') == 'Uniform']
    for g in grids:
        assert int(g.find('Topology').get('NumberOfElements')) == n
        points = data(g.find('Geometry/DataItem'))
        assert points.shape == (n, 3)
        values = {a.get('Name'): data(a.find('DataItem')) for a in g.iter('Attribute')}
        assert all(v.shape[0] == n for v in values.values())
        seen.setdefault(name, []).append((points, values, g.find('Time')))
assert set(seen['a.model'][0][1]) >= {'radius', 'mass', 'velocity', 'species', 'release', 'material'}
assert np.allclose(seen['t.model'][0][0][0], [-25, 25, 25])
frames = seen['a & b.traj']
assert len(frames) == 3 and [float(t.get('Value')) for _, _, t in frames] == [0.0, 0.1, 0.2]
assert [p[7].tolist() for p, _, _ in frames] == [[7, 0.25 * f, -1.5] for f in range(3)]
assert [v['velocity'][7, 1] for _, v, _ in frames] == [-0.25 * f for f in range(3)]
)");
}

/// Rows in messages are those of the whole model, whichever part is read.
TEST_F(OtherPrograms, parts_of_a_model) {
    const std::string ten = R"(
f = h5py.File(at + 'm.h5', 'w')
f.create_group('granular').attrs.update({'kind': 'model', 'complete': 1})
p = f.create_group('particles/all')
p['position/value'] = np.arange(60.).reshape(2, 10, 3); p['position/step'] = [0, 1]; p['position/time'] = [0., 1.]
p['radius'] = np.arange(1., 11.)
p['material'] = np.arange(10)
)";
    python(ten);
    const ModelFile file = read_model(path("m.h5"), {2, 4});
    const Grains& part = std::get<Grains>(file.model);
    EXPECT_EQ(file.first, 5u);
    EXPECT_EQ(file.total, 10u);
    EXPECT_EQ(part.position, (std::vector<Vec3>{{45, 46, 47}, {48, 49, 50}}));
    EXPECT_EQ(part.radius, (std::vector<double>{6, 7}));
    EXPECT_EQ(part.material, (std::vector<std::uint8_t>{5, 6}));
    const auto refused = [&](const std::string& change, const std::string& place, const std::string& what) {
        python(ten + change);
        expect_error(ExitCode::input_invalid, {"m.h5", place, what}, [&] {
            read_model(path("m.h5"), {2, 4});
        });
    };
    refused("p['radius'][6] = -1", "/particles/all/radius", "row 6 is -1");
    refused("p['position/value'][1, 5, 1] = np.inf", "/particles/all/position", "row 5 is");
    refused("p['material'][6] = 256", "/particles/all/material", "row 6 is 256");
    refused("p['species'] = np.array([0, 0, 0, 0, 0, 3, 0, 0, 0, 0])", "/particles/all/species",
            "row 5 is 3");
    refused("p['mass'] = np.ones(9)", "/particles/all/mass", "has 9 rows, position has 10");
    python(ten + "p['radius'][1] = -1"); // somebody else's
    EXPECT_EQ(std::get<Grains>(read_model(path("m.h5"), {2, 4}).model).size(), 2u);
}

/// A resumed trajectory has every dataset and attribute of one that was not interrupted, bit by bit.
TEST_F(OtherPrograms, resumed_trajectory) {
    const auto run = [&](const std::string& name, bool interrupted) {
        TrajectoryWriter writer(name, sample_statics(), sample_provenance(), "{}", false);
        write_frames(writer, 30, 3);
        if (interrupted) {
            const TrajectoryImage image = writer.image();
            write_frames(writer, 30, 5);
            writer.suspend();
            TrajectoryWriter again =
                TrajectoryWriter::resume(name, image, sample_statics(), sample_provenance(), "{}", false);
            write_frames(again, 30, 4);
            again.finish();
            return;
        }
        write_frames(writer, 30, 4);
        writer.finish();
    };
    run(path("a.h5"), false);
    run(path("b.h5"), true);
    python(R"(
def everything(name):
    found = {}
    def add(path, item):
        found[path] = (item[()].tobytes(), item.dtype, item.shape) if isinstance(item, h5py.Dataset) else None
        for key, value in item.attrs.items():
            found[path, key] = (np.asarray(value).tobytes(), np.asarray(value).dtype)
        return None
    with h5py.File(at + name, 'r') as f:
        def walk(group, path):
            for key, item in group.items():
                add(path + key, item)
                if isinstance(item, h5py.Group):
                    walk(item, path + key + '/')
        walk(f, '/')
    return found
a, b = everything('a.h5'), everything('b.h5')
assert a.keys() == b.keys(), a.keys() ^ b.keys()
assert [k for k in a if a[k] != b[k]] == []
assert len(a) > 100
)");
}

} // namespace
} // namespace talus::io::test
