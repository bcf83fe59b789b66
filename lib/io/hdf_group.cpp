// SPDX-License-Identifier: GPL-3.0-or-later
#include "io/hdf_file.hpp"

#include <algorithm>
#include <fmt/format.h>

namespace talus::io::hdf {
namespace {

constexpr std::size_t object_header_limit = 60000; ///< bytes of text that still fit into an object header

/// Fixed length, null padded; ASCII where the text is.
Id string_type(const std::vector<std::string>& texts) {
    std::size_t length = 1;
    bool ascii = true;
    for (const std::string& text : texts) {
        length = std::max(length, text.size());
        ascii = ascii && std::all_of(text.begin(), text.end(), [](unsigned char c) { return c < 128; });
    }
    Id type(H5Tcopy(H5T_C_S1), H5Tclose);
    H5Tset_size(type, length);
    H5Tset_strpad(type, H5T_STR_NULLPAD);
    H5Tset_cset(type, ascii ? H5T_CSET_ASCII : H5T_CSET_UTF8);
    return type;
}

std::string packed(const std::vector<std::string>& texts, std::size_t length) {
    std::string data(std::max<std::size_t>(1, texts.size()) * length, '\0');
    for (std::size_t i = 0; i < texts.size(); ++i)
        texts[i].copy(data.data() + i * length, length);
    return data;
}

/// Texts of a dataset or an attribute, of fixed or variable length; `read` calls H5Dread or H5Aread.
template <class Read>
std::vector<std::string> unpacked(hid_t type, std::size_t count, Read read) {
    std::vector<std::string> texts;
    if (H5Tis_variable_str(type) > 0) {
        std::vector<char*> pointers(count, nullptr);
        if (read(type, pointers.data()) < 0)
            return texts;
        for (char* pointer : pointers) {
            texts.emplace_back(pointer ? pointer : "");
            if (pointer)
                H5free_memory(pointer);
        }
        return texts;
    }
    const std::size_t length = H5Tget_size(type);
    std::string data(count * length, '\0');
    if (read(type, data.data()) < 0)
        return texts;
    for (std::size_t i = 0; i < count; ++i) {
        const std::string text = data.substr(i * length, length);
        texts.push_back(text.substr(0, text.find('\0')));
    }
    return texts;
}

std::size_t count_of(hid_t space) {
    return static_cast<std::size_t>(std::max<hssize_t>(0, H5Sget_simple_extent_npoints(space)));
}

} // namespace

Group::Group(const Context* context, std::string path, Id id)
    : context_(context), path_(std::move(path)), id_(std::move(id)) {}

std::string Group::path(std::string_view name) const {
    if (name.starts_with('/'))
        return std::string(name);
    return path_ == "/" ? fmt::format("/{}", name) : fmt::format("{}/{}", path_, name);
}

bool Group::has(const std::string& name) const {
    if (name.empty() || name == "/")
        return true;
    for (std::size_t end = name.find('/', 1);; end = name.find('/', end + 1)) {
        const std::string part = name.substr(0, end);
        const htri_t exists = H5Lexists(id_, part.c_str(), H5P_DEFAULT);
        if (exists < 0) // not the same as absent: the group cannot be read
            context_->fail_hdf(path(part), "looked up");
        if (exists == 0)
            return false;
        if (end == std::string::npos)
            break;
    }
    return H5Oexists_by_name(id_, name.c_str(), H5P_DEFAULT) > 0;
}

bool Group::is_group(const std::string& name) const {
    if (!has(name))
        return false;
    const Id object(H5Oopen(id_, name.c_str(), H5P_DEFAULT), H5Oclose);
    if (!object.valid())
        context_->fail_hdf(path(name), "opened");
    return H5Iget_type(object) == H5I_GROUP;
}

std::vector<std::string> Group::names() const {
    std::vector<std::string> names;
    const auto add = [](hid_t, const char* name, const H5L_info_t*, void* data) -> herr_t {
        static_cast<std::vector<std::string>*>(data)->emplace_back(name);
        return 0;
    };
    if (H5Literate(id_, H5_INDEX_NAME, H5_ITER_INC, nullptr, add, &names) < 0)
        context_->fail_hdf(path_, "listed");
    std::sort(names.begin(), names.end());
    return names;
}

Group Group::group(const std::string& name) const {
    if (!has(name))
        context_->fail(path(name), "is missing; make the file anew");
    Id id(H5Gopen2(id_, name.c_str(), H5P_DEFAULT), H5Gclose);
    if (!id.valid())
        context_->fail_hdf(path(name), "opened as a group");
    return {context_, path(name), std::move(id)};
}

Dataset Group::dataset(const std::string& name) const {
    if (!has(name))
        context_->fail(path(name), "is missing; make the file anew with this dataset");
    Id id(H5Dopen2(id_, name.c_str(), H5P_DEFAULT), H5Dclose);
    if (!id.valid())
        context_->fail_hdf(path(name), "opened as a dataset");
    return {context_, path(name), std::move(id)};
}

Group Group::create_group(const std::string& name) const {
    const Id creation(H5Pcreate(H5P_GROUP_CREATE), H5Pclose);
    H5Pset_obj_track_times(creation, false);
    for (std::size_t end = name.find('/', 1);; end = name.find('/', end + 1)) {
        const std::string part = name.substr(0, end);
        if (!has(part)) {
            const Id id(H5Gcreate2(id_, part.c_str(), H5P_DEFAULT, creation, H5P_DEFAULT), H5Gclose);
            if (!id.valid())
                context_->fail_hdf(path(part), "created");
        }
        if (end == std::string::npos)
            break;
    }
    return group(name);
}

void Group::write_text(const std::string& name, const std::string& text) const {
    const Id type = string_type({text});
    if (text.size() > object_header_limit) {
        return create(name, type, {1}, {}).write_text(type, text.data());
    }
    context_->expect(text.size());
    const Id creation(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    H5Pset_obj_track_times(creation, false);
    H5Pset_layout(creation, H5D_COMPACT);
    const Id space(H5Screate(H5S_SCALAR), H5Sclose);
    const Id id(H5Dcreate2(id_, name.c_str(), type, space, H5P_DEFAULT, creation, H5P_DEFAULT), H5Dclose);
    context_->settle(id.valid() && H5Dwrite(id, type, H5S_ALL, H5S_ALL, H5P_DEFAULT,
                                            packed({text}, H5Tget_size(type)).data()) >= 0,
                     path(name), "written");
}

void Group::write_texts(const std::string& name, const std::vector<std::string>& texts) const {
    const Id type = string_type(texts);
    create(name, type, {texts.size()}, {.filter = Filter::compressed})
        .write_text(type, packed(texts, H5Tget_size(type)).data());
}

std::vector<std::string> Group::read_texts(const std::string& name) const {
    const Dataset from = dataset(name);
    const Id type(H5Dget_type(from.id()), H5Tclose);
    if (H5Tget_class(type) != H5T_STRING)
        context_->fail(path(name), "holds no text; make the file anew");
    auto texts = unpacked(type, from.size(), [&](hid_t t, void* out) {
        return H5Dread(from.id(), t, H5S_ALL, H5S_ALL, H5P_DEFAULT, out);
    });
    if (texts.size() != from.size())
        context_->fail_hdf(path(name), "read");
    return texts;
}

std::string Group::read_text(const std::string& name) const {
    const auto texts = read_texts(name);
    return texts.empty() ? "" : texts.front();
}

void Group::link(const std::string& name, const Group& from, const std::string& target) const {
    if (H5Lcreate_hard(from.id(), target.c_str(), id_, name.c_str(), H5P_DEFAULT, H5P_DEFAULT) < 0)
        context_->fail_hdf(path(name), "linked");
}

void Group::unlink(const std::string& name) const {
    if (H5Ldelete(id_, name.c_str(), H5P_DEFAULT) < 0)
        context_->fail_hdf(path(name), "replaced");
}

// ---- attributes

namespace {

void set_attribute(const Context& context, hid_t holder, const std::string& place, const std::string& name,
                   hid_t memory, hid_t stored, const Dims& dims, const void* data) {
    const Id space(dims.empty() ? H5Screate(H5S_SCALAR)
                                : H5Screate_simple(static_cast<int>(dims.size()), dims.data(), nullptr),
                   H5Sclose);
    if (H5Aexists(holder, name.c_str()) > 0) { // same type and shape: complete = 0, then 1
        const Id old(H5Aopen(holder, name.c_str(), H5P_DEFAULT), H5Aclose);
        if (H5Awrite(old, memory, data) < 0)
            context.fail_hdf(fmt::format("{}: attribute {}", place, name), "written");
        return;
    }
    const Id id(H5Acreate2(holder, name.c_str(), stored, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
    if (!id.valid() || H5Awrite(id, memory, data) < 0)
        context.fail_hdf(fmt::format("{}: attribute {}", place, name), "written");
    context.check_writes();
}

void set_texts(const Context& context, hid_t holder, const std::string& place, const std::string& name,
               const std::vector<std::string>& texts, const Dims& dims) {
    const Id type = string_type(texts);
    set_attribute(context, holder, place, name, type, type, dims, packed(texts, H5Tget_size(type)).data());
}

struct Value {
    std::vector<double> numbers;
    std::vector<std::int64_t> integers; ///< where the file holds integers
    std::vector<std::string> texts;
};

/// Reads numbers or texts through `read(memory type, buffer)`.
template <class Read>
Value value_of(hid_t type, std::size_t count, Read read) {
    Value value;
    switch (H5Tget_class(type)) {
    case H5T_STRING:
        value.texts = unpacked(type, count, read);
        break;
    case H5T_FLOAT:
        value.numbers.resize(count);
        if (read(H5T_NATIVE_DOUBLE, value.numbers.data()) < 0)
            value.numbers.clear();
        break;
    case H5T_ENUM: { // h5py writes True and False as an 8-bit enumeration
        const std::size_t size = H5Tget_size(type);
        std::vector<unsigned char> raw(count * size);
        if (read(type, raw.data()) >= 0)
            for (std::size_t i = 0; i < count; ++i) {
                std::int64_t sum = 0;
                for (std::size_t k = 0; k < size; ++k)
                    sum |= raw[i * size + k];
                value.integers.push_back(sum != 0);
            }
        break;
    }
    case H5T_INTEGER:
        value.integers.resize(count);
        if (read(H5T_NATIVE_INT64, value.integers.data()) < 0)
            value.integers.clear();
        break;
    default:
        break;
    }
    for (const std::int64_t i : value.integers)
        value.numbers.push_back(static_cast<double>(i));
    return value;
}

/// Absent attributes give an empty value; what cannot be read is an Error.
Value attribute_of(const Context& context, hid_t holder, const std::string& place, const std::string& name) {
    const htri_t exists = H5Aexists(holder, name.c_str());
    if (exists == 0)
        return {};
    const Id id(exists > 0 ? H5Aopen(holder, name.c_str(), H5P_DEFAULT) : -1, H5Aclose);
    const Id type(H5Aget_type(id), H5Tclose), space(H5Aget_space(id), H5Sclose);
    Value value;
    if (id.valid() && type.valid() && space.valid())
        value = value_of(type, count_of(space), [&](hid_t t, void* out) { return H5Aread(id, t, out); });
    if (value.texts.empty() && value.numbers.empty())
        context.fail_hdf(fmt::format("{}: attribute {}", place, name), "read");
    return value;
}

Value find_value(const Group& group, const std::string& name) {
    Value value = attribute_of(group.context(), group.id(), group.path(), name);
    if (!value.texts.empty() || !value.numbers.empty() || !group.has(name) || group.is_group(name))
        return value;
    const Dataset dataset = group.dataset(name);
    const Id type(H5Dget_type(dataset.id()), H5Tclose), space(H5Dget_space(dataset.id()), H5Sclose);
    value = value_of(type, count_of(space), [&](hid_t t, void* out) {
        return H5Dread(dataset.id(), t, H5S_ALL, H5S_ALL, H5P_DEFAULT, out);
    });
    if (value.texts.empty() && value.numbers.empty())
        group.context().fail_hdf(dataset.path(), "read");
    return value;
}

template <class T>
std::optional<T> first(const std::vector<T>& values) {
    return values.empty() ? std::nullopt : std::optional<T>(values.front());
}

Value attribute_below(const Group& group, const std::string& holder, const std::string& name) {
    const Id object(H5Oopen(group.id(), holder.c_str(), H5P_DEFAULT), H5Oclose);
    if (!object.valid())
        group.context().fail_hdf(group.path(holder), "opened");
    return attribute_of(group.context(), object, group.path(holder), name);
}

} // namespace

void Dataset::set(const std::string& name, std::span<const double> values) const {
    set_attribute(*context_, id_, path_, name, H5T_NATIVE_DOUBLE, H5T_IEEE_F64LE, {values.size()},
                  values.data());
}
void Dataset::set(const std::string& name, const std::string& text) const {
    set_texts(*context_, id_, path_, name, {text}, {});
}

void Group::set(const std::string& name, double value) const {
    set_attribute(*context_, id_, path_, name, H5T_NATIVE_DOUBLE, H5T_IEEE_F64LE, {}, &value);
}
void Group::set(const std::string& name, std::int64_t value) const {
    set_attribute(*context_, id_, path_, name, H5T_NATIVE_INT64, H5T_STD_I64LE, {}, &value);
}
void Group::set(const std::string& name, const std::string& text) const {
    set_texts(*context_, id_, path_, name, {text}, {});
}
void Group::set(const std::string& name, std::span<const double> values) const {
    set_attribute(*context_, id_, path_, name, H5T_NATIVE_DOUBLE, H5T_IEEE_F64LE, {values.size()},
                  values.data());
}
void Group::set(const std::string& name, std::span<const std::int64_t> values) const {
    set_attribute(*context_, id_, path_, name, H5T_NATIVE_INT64, H5T_STD_I64LE, {values.size()},
                  values.data());
}
void Group::set(const std::string& name, const std::vector<std::string>& texts) const {
    set_texts(*context_, id_, path_, name, texts, {texts.size()});
}

std::optional<double> Group::number(const std::string& name) const {
    return first(find_value(*this, name).numbers);
}
std::optional<std::int64_t> Group::integer(const std::string& name) const {
    const Value value = find_value(*this, name);
    if (value.integers.empty() && !value.numbers.empty() &&
        value.numbers[0] == static_cast<double>(static_cast<std::int64_t>(value.numbers[0])))
        return static_cast<std::int64_t>(value.numbers[0]); // 1.0 for 1
    return first(value.integers);
}
std::optional<std::string> Group::text(const std::string& name) const {
    return first(find_value(*this, name).texts);
}
std::vector<double> Group::numbers(const std::string& name) const {
    return find_value(*this, name).numbers;
}
std::vector<std::string> Group::texts(const std::string& name) const {
    return find_value(*this, name).texts;
}

Attributes Group::attributes() const {
    std::vector<std::string> names;
    const auto add = [](hid_t, const char* name, const H5A_info_t*, void* data) -> herr_t {
        static_cast<std::vector<std::string>*>(data)->emplace_back(name);
        return 0;
    };
    if (H5Aiterate2(id_, H5_INDEX_NAME, H5_ITER_INC, nullptr, add, &names) < 0)
        context_->fail_hdf(path_, "read");
    Attributes attributes;
    for (const std::string& name : names) {
        const Value value = attribute_of(*context_, id_, path_, name);
        if (!value.texts.empty())
            attributes[name] = value.texts.front();
        else if (!value.integers.empty())
            attributes[name] = value.integers.front();
        else if (!value.numbers.empty())
            attributes[name] = value.numbers.front();
        else
            context_->fail_hdf(fmt::format("{}: attribute {}", path_, name), "read");
    }
    return attributes;
}

void Group::set(const Attributes& attributes) const {
    for (const auto& [name, value] : attributes)
        std::visit([&, &key = name](const auto& v) { set(key, v); }, value);
}

std::vector<double> attribute_numbers(const Group& group, const std::string& holder,
                                      const std::string& name) {
    return attribute_below(group, holder, name).numbers;
}
std::optional<std::string> attribute_text(const Group& group, const std::string& holder,
                                          const std::string& name) {
    return first(attribute_below(group, holder, name).texts);
}

} // namespace talus::io::hdf
