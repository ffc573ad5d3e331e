// SPDX-License-Identifier: Apache-2.0
// Messages in the serialized form of the middleware (CDR, little-endian), as flat tuples of their values.
//
// A layout names the values of a message in order: B a uint8 or bool, i an int32, I a uint32, d a double, F<n> n doubles
// next to each other, s a string; D, L and U sequences of doubles, int32 and uint8, S a sequence of strings.
#include <cstring>

#include "core.hpp"

namespace plsing {
namespace {

// In front of every message: which form it has. Alignment counts from behind it.
constexpr char header[4] = {0, 1, 0, 0};

class Layout {
public:
    explicit Layout(const std::string &text) : next_(text.data()), end_(next_ + text.size()) {}
    bool has_more() const { return next_ != end_; }

    // The next kind of value; how many doubles it has is in `count`.
    char kind()
    {
        const char found = *next_++;
        for (count = 0; has_more() && *next_ >= '0' && *next_ <= '9'; next_++) count = 10 * count + (*next_ - '0');
        return found;
    }

    std::size_t count = 0;

private:
    const char *next_, *end_;
};

class Reader {
public:
    explicit Reader(const py::bytes &data)
    {
        char *first;
        Py_ssize_t size;
        if (PyBytes_AsStringAndSize(data.ptr(), &first, &size) != 0) throw py::error_already_set();
        require(size >= 4 && std::memcmp(first, header, 2) == 0, "no message in little-endian CDR");
        begin_ = next_ = first + 4;
        end_ = first + size;
    }

    template <typename Number>
    Number number()
    {
        Number value;
        std::memcpy(&value, take(1, sizeof(Number)), sizeof(Number));
        return value;
    }

    template <typename Number>
    py::object array(std::size_t count)
    {
        const char *from = take(count, sizeof(Number));
        py::array_t<Number> values(static_cast<Index>(count));
        if (count > 0) std::memcpy(values.mutable_data(), from, count * sizeof(Number));
        return values;
    }

    py::object integers(std::size_t count)
    {
        const char *from = take(count, sizeof(std::int32_t));
        py::tuple values(static_cast<Index>(count));
        for (std::size_t i = 0; i < count; i++) {
            std::int32_t value;
            std::memcpy(&value, from + i * sizeof value, sizeof value);
            values[i] = value;
        }
        return std::move(values);
    }

    py::object string()
    {
        const auto size = number<std::uint32_t>();
        const char *first = take(size, 1);
        // With its final zero; a sender may write an empty one without.
        return py::reinterpret_steal<py::object>(
            PyUnicode_DecodeUTF8(first, static_cast<Py_ssize_t>(size > 0 ? size - 1 : 0), "replace"));
    }

    std::size_t left() const { return static_cast<std::size_t>(end_ - next_); }

private:
    const char *take(std::size_t count, std::size_t size)
    {
        if (count == 0) return next_;
        const std::size_t off = static_cast<std::size_t>(next_ - begin_) % size;
        const std::size_t gap = off == 0 ? 0 : size - off;
        require(gap <= left() && count <= (left() - gap) / size, "a serialized message ends before its last value");
        const char *first = next_ + gap;
        next_ = first + count * size;
        return first;
    }

    const char *begin_, *next_, *end_;
};

py::tuple read_serialized(const std::string &text, const py::bytes &data)
{
    Reader reader(data);
    Layout layout(text);
    py::list values;
    while (layout.has_more()) {
        switch (layout.kind()) {
            case 'B': values.append(reader.number<std::uint8_t>()); break;
            case 'i': values.append(reader.number<std::int32_t>()); break;
            case 'I': values.append(reader.number<std::uint32_t>()); break;
            case 'd': values.append(reader.number<double>()); break;
            case 'F': values.append(reader.array<double>(layout.count)); break;
            case 's': values.append(reader.string()); break;
            case 'D': values.append(reader.array<double>(reader.number<std::uint32_t>())); break;
            case 'L': values.append(reader.integers(reader.number<std::uint32_t>())); break;
            case 'U': values.append(reader.array<std::uint8_t>(reader.number<std::uint32_t>())); break;
            default: throw std::invalid_argument("a value of this kind is not read: " + text);
        }
    }
    return py::tuple(values);
}

class Writer {
public:
    Writer() : bytes_(header, sizeof header) {}

    void put(const void *first, std::size_t count, std::size_t size)
    {
        if (count == 0) return;
        const std::size_t off = (bytes_.size() - sizeof header) % size;
        bytes_.append(off == 0 ? 0 : size - off, '\0');
        bytes_.append(static_cast<const char *>(first), count * size);
    }

    template <typename Number>
    void number(py::handle value)
    {
        const auto number = value.cast<Number>();
        put(&number, 1, sizeof number);
    }

    void size(std::size_t value)
    {
        const auto size = static_cast<std::uint32_t>(value);
        put(&size, 1, sizeof size);
    }

    void string(py::handle value)
    {
        Py_ssize_t length;
        const char *first = PyUnicode_AsUTF8AndSize(value.ptr(), &length);
        if (first == nullptr) throw py::error_already_set();
        size(static_cast<std::size_t>(length) + 1);
        put(first, static_cast<std::size_t>(length) + 1, 1);
    }

    void doubles(py::handle value, std::size_t count)
    {
        require(py::len(value) == count, "there must be as many doubles as in a layout");
        if (py::isinstance<py::tuple>(value)) {
            for (const auto &each : value) number<double>(each);
            return;
        }
        const auto values = value.cast<py::array_t<double, py::array::c_style | py::array::forcecast>>();
        require(static_cast<std::size_t>(values.size()) == count, "doubles must be a tuple or of one dimension");
        put(values.data(), count, sizeof(double));
    }

    py::bytes bytes() const { return py::bytes(bytes_); }

private:
    std::string bytes_;
};

py::bytes write_serialized(const std::string &text, const py::tuple &values)
{
    Writer writer;
    Layout layout(text);
    std::size_t i = 0;
    while (layout.has_more()) {
        const char kind = layout.kind();
        require(i < values.size(), "there must be a value for each of a layout");
        const py::handle value = values[i++];
        switch (kind) {
            case 'B': writer.number<std::uint8_t>(value); break;
            case 'i': writer.number<std::int32_t>(value); break;
            case 'I': writer.number<std::uint32_t>(value); break;
            case 'd': writer.number<double>(value); break;
            case 'F': writer.doubles(value, layout.count); break;
            case 's': writer.string(value); break;
            case 'D':
                writer.size(py::len(value));
                writer.doubles(value, py::len(value));
                break;
            case 'S':
                writer.size(py::len(value));
                for (const auto &each : value) writer.string(each);
                break;
            default: throw std::invalid_argument("a value of this kind is not written: " + text);
        }
    }
    require(i == values.size(), "there must be a value for each of a layout");
    return writer.bytes();
}

}  // namespace

void bind_serialized(py::module_ &module)
{
    module.def("read_serialized", &read_serialized);
    module.def("write_serialized", &write_serialized);
}

}  // namespace plsing
