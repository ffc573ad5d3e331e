// SPDX-License-Identifier: Apache-2.0
// Messages in the Common Data Representation that ROS sends (CDR, little-endian), all fields at once. A layout has one
// letter for each field: ? bool, B uint8, i int32, I uint32, d float64, s string; numbers of a fixed count have it before
// them, sequences a *.
#include <algorithm>
#include <cstring>

#include "locked.hpp"

namespace plsing {
namespace {

constexpr char head[] = {0, 1, 0, 0};
constexpr Index one = -1, sequence = -2;

// Goes through a layout, field by field.
class Layout {
public:
    explicit Layout(const std::string &letters) : at_(letters.c_str()) {}
    bool next()
    {
        count = *at_ == '*' ? sequence : one;
        if (count == sequence)
            at_++;
        for (; *at_ >= '0' && *at_ <= '9' && count < 1000; at_++)
            count = 10 * std::max<Index>(count, 0) + (*at_ - '0');
        letter = *at_;
        return *at_++ != 0;
    }
    char letter = 0;
    Index count = one;

private:
    const char *at_;
};

[[noreturn]] void refuse_layout()
{
    throw std::invalid_argument("a layout must have a letter for each field that is read or written");
}

// Reads what is there, and finds itself broken where it is not.
class Reader {
public:
    Reader(const char *data, size_t size) : first_(data + sizeof head), at_(first_), end_(data + size)
    {
        broken = size < sizeof head || std::memcmp(data, head, 2) != 0;
    }
    // The place of so many numbers, aligned as the first of them has to be; null if there are not as many.
    template <typename Number>
    const char *take(size_t count)
    {
        const size_t skipped = count == 0 ? 0 : -static_cast<size_t>(at_ - first_) % sizeof(Number);
        if (broken || skipped > size_t(end_ - at_) || count > (size_t(end_ - at_) - skipped) / sizeof(Number)) {
            broken = true;
            return nullptr;
        }
        const char *found = at_ + skipped;
        at_ = found + count * sizeof(Number);
        return found;
    }
    template <typename Number>
    Number number()
    {
        Number value{};
        if (const char *found = take<Number>(1))
            std::memcpy(&value, found, sizeof value);
        return value;
    }
    bool broken;

private:
    const char *first_, *at_, *end_;
};

py::object string_of(Reader &reader)
{
    const auto size = reader.number<uint32_t>();
    const char *found = reader.take<char>(size);
    if (found == nullptr)
        return py::none();
    return py::reinterpret_steal<py::object>(
        PyUnicode_DecodeUTF8(found, static_cast<Py_ssize_t>(strnlen(found, size)), "replace"));
}

py::object numbers_of(Reader &reader, size_t count)
{
    const char *found = reader.take<double>(count);
    if (found == nullptr)
        return py::none();
    py::array_t<double> array(static_cast<Index>(count));
    std::copy_n(found, count * sizeof(double), reinterpret_cast<char *>(array.mutable_data()));
    return locked(std::move(array));
}

py::object field_of(Reader &reader, char letter, Index count)
{
    if (count == one) {
        switch (letter) {
        case '?': return py::bool_(reader.number<uint8_t>() != 0);
        case 'B': return py::int_(reader.number<uint8_t>());
        case 'i': return py::int_(reader.number<int32_t>());
        case 'I': return py::int_(reader.number<uint32_t>());
        case 'd': return py::float_(reader.number<double>());
        case 's': return string_of(reader);
        default: refuse_layout();
        }
    }
    const size_t size = count == sequence ? reader.number<uint32_t>() : static_cast<size_t>(count);
    if (letter == 'd')
        return numbers_of(reader, size);
    if (letter == 'B') {
        const char *found = reader.take<char>(size);
        return found == nullptr ? py::object(py::none()) : py::bytes(found, size);
    }
    if (letter != 'i' && letter != 's')
        refuse_layout();
    py::list values;
    for (size_t i = 0; i < size && !reader.broken; i++)
        values.append(field_of(reader, letter, one));
    return py::tuple(values);
}

py::object unpack(const std::string &layout, const py::bytes &data)
{
    char *first = nullptr;
    Py_ssize_t size = 0;
    if (PyBytes_AsStringAndSize(data.ptr(), &first, &size) != 0)
        throw py::error_already_set();
    Reader reader(first, static_cast<size_t>(size));
    py::list fields;
    for (Layout field(layout); !reader.broken && field.next();)
        fields.append(field_of(reader, field.letter, field.count));
    if (reader.broken)
        return py::none();
    return py::tuple(fields);
}

class Writer {
public:
    Writer() { data.reserve(2048); }
    template <typename Number>
    void numbers(const Number *values, size_t count)
    {
        if (count == 0)
            return;
        data.append(-(data.size() - sizeof head) % sizeof(Number), '\0');
        data.append(reinterpret_cast<const char *>(values), count * sizeof(Number));
    }
    template <typename Number>
    void number(Number value)
    {
        numbers(&value, 1);
    }
    void string(const py::handle &value)
    {
        Py_ssize_t size = 0;
        const char *text = PyUnicode_AsUTF8AndSize(value.ptr(), &size);
        if (text == nullptr)
            throw py::error_already_set();
        number(static_cast<uint32_t>(size + 1));
        numbers(text, static_cast<size_t>(size) + 1);
    }
    std::string data{head, sizeof head};
};

void write_field(Writer &writer, char letter, Index count, const py::handle &value)
{
    if (count == one) {
        switch (letter) {
        case '?': return writer.number(static_cast<uint8_t>(value.cast<bool>()));
        case 'B': return writer.number(value.cast<uint8_t>());
        case 'i': return writer.number(value.cast<int32_t>());
        case 'I': return writer.number(value.cast<uint32_t>());
        case 'd': return writer.number(value.cast<double>());
        case 's': return writer.string(value);
        default: refuse_layout();
        }
    }
    const size_t size = py::len(value);
    require(count == sequence || size == static_cast<size_t>(count), "there must be as many values as the field has");
    if (count == sequence)
        writer.number(static_cast<uint32_t>(size));
    if (letter == 'd') {
        const auto array = py::array_t<double, py::array::c_style | py::array::forcecast>::ensure(value);
        require(array && static_cast<size_t>(array.size()) == size, "an array must have one dimension");
        return writer.numbers(array.data(), size);
    }
    for (const py::handle each : value)
        write_field(writer, letter, one, each);
}

py::bytes pack(const std::string &layout, const py::tuple &values)
{
    Writer writer;
    size_t i = 0;
    for (Layout field(layout); field.next(); i++) {
        require(i < values.size(), "there must be a value for each field");
        write_field(writer, field.letter, field.count, values[i]);
    }
    require(i == values.size(), "there must be a field for each value");
    return writer.data;
}

}  // namespace

void bind_serialization(py::module_ &module)
{
    module.def("unpack", &unpack);
    module.def("pack", &pack);
}

}  // namespace plsing
