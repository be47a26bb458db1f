#include "io/e57/compressed_vector.h"

#include <algorithm>
#include <cstring>

namespace lapseam {
namespace {

constexpr std::uint64_t kSectionHeaderBytes = 32, kBlobHeaderBytes = 16, kPacketHeaderBytes = 6;
constexpr std::uint8_t kIndexPacket = 0, kDataPacket = 1, kEmptyPacket = 2;
// A number may be read as the eight bytes that it begins in, and one more.
constexpr std::size_t kPadding = 16;

struct SectionHeader {
  std::uint8_t id, reserved[7];
  std::uint64_t section_bytes, data_offset, index_offset;
};
static_assert(sizeof(SectionHeader) == kSectionHeaderBytes);

struct PacketHeader {
  std::uint8_t type, flags;
  std::uint16_t bytes_minus_1, streams;
};
static_assert(sizeof(PacketHeader) == kPacketHeaderBytes);

std::uint64_t load_64(const char* bytes) {
  std::uint64_t word;
  std::memcpy(&word, bytes, sizeof word);
  return word;
}

}  // namespace

void E57Stream::append(PagedFile& file, std::uint64_t offset, std::size_t count) {
  // What has been taken makes room, now and then.
  const std::size_t used = used_bits_ / 8;
  const std::size_t held = bytes_.empty() ? 0 : bytes_.size() - kPadding;
  if (used > 0 && used >= held / 2) {
    std::memmove(bytes_.data(), bytes_.data() + used, held - used);
    used_bits_ -= used * 8;
    bytes_.resize(held - used + count + kPadding);
    file.read(offset, count, bytes_.data() + held - used);
  } else {
    bytes_.resize(held + count + kPadding);
    file.read(offset, count, bytes_.data() + held);
  }
  std::memset(bytes_.data() + bytes_.size() - kPadding, 0, kPadding);
}

std::uint64_t E57Stream::records() const {
  if (field_.bits == 0) return ~std::uint64_t(0);
  const std::uint64_t held = bytes_.empty() ? 0 : bytes_.size() - kPadding;
  return (held * 8 - used_bits_) / std::uint64_t(field_.bits);
}

void E57Stream::take(std::size_t count, double* out) {
  const char* bytes = bytes_.data() + used_bits_ / 8;
  if (field_.kind == E57Field::Kind::kDouble) {
    std::memcpy(out, bytes, count * sizeof(double));
  } else if (field_.kind == E57Field::Kind::kFloat) {
    for (std::size_t i = 0; i < count; ++i) {
      float value;
      std::memcpy(&value, bytes + i * sizeof value, sizeof value);
      out[i] = double(value);
    }
  } else {
    take_packed(count, out);
  }
  used_bits_ += count * std::size_t(field_.bits);
}

void E57Stream::take_packed(std::size_t count, double* out) {
  const bool is_scaled = field_.kind == E57Field::Kind::kScaledInteger;
  const double scale = is_scaled ? field_.scale : 1, offset = is_scaled ? field_.offset : 0;
  const auto minimum = std::uint64_t(field_.minimum);
  const auto to_number = [&](std::uint64_t packed) {
    const double value = double(std::int64_t(packed + minimum));
    return is_scaled ? value * scale + offset : value;
  };
  if (field_.bits == 0) {
    std::fill(out, out + count, to_number(0));
    return;
  }
  const auto bits = std::size_t(field_.bits);
  const std::uint64_t mask = bits == 64 ? ~std::uint64_t(0) : (std::uint64_t(1) << bits) - 1;
  std::size_t at = used_bits_;
  for (std::size_t i = 0; i < count; ++i, at += bits) {
    const char* bytes = bytes_.data() + at / 8;
    const std::size_t shift = at % 8;
    std::uint64_t packed = load_64(bytes) >> shift;
    if (shift + bits > 64) packed |= load_64(bytes + 8) << (64 - shift);
    out[i] = to_number(packed & mask);
  }
}

E57Records::E57Records(PagedFile& file, const E57Scan& scan, std::vector<int> wanted)
    : file_(file), scan_(scan), wanted_(std::move(wanted)), left_(scan.record_count) {
  SectionHeader header;
  const std::uint64_t begin = to_logical(scan.section_offset);
  file_.read(begin, sizeof header, reinterpret_cast<char*>(&header));
  if (header.id != 1) file_.source().refuse("points", "there is no CompressedVector section at its fileOffset");
  position_ = to_logical(header.data_offset);
  end_ = header.section_bytes > file_.logical_bytes() - begin ? file_.logical_bytes() : begin + header.section_bytes;
  std::uint64_t bits = 0;
  for (const E57Field& field : scan.fields) bits += std::uint64_t(field.bits);
  const std::uint64_t held_bits = position_ < end_ ? (end_ - position_) * 8 : 0;
  if (bits == 0 || left_ > held_bits / bits)
    file_.source().refuse("points.recordCount",
                          "claims " + std::to_string(left_) + " records, more than the section holds");
  for (const int field : wanted_) {
    streams_.emplace_back(scan.fields[std::size_t(field)]);
    columns_.emplace_back();
  }
}

void E57Records::refuse_truncated() const {
  file_.source().refuse("points", "the section ends " + std::to_string(left_) + " records early");
}

void E57Records::read_packet() {
  PacketHeader header;
  if (position_ + kPacketHeaderBytes > end_) refuse_truncated();
  file_.read(position_, sizeof header, reinterpret_cast<char*>(&header));
  const std::uint64_t bytes = std::uint64_t(header.bytes_minus_1) + 1;
  if (bytes < 4 || bytes > end_ - position_) refuse_truncated();
  const std::uint64_t packet = position_;
  position_ += bytes;
  if (header.type == kIndexPacket || header.type == kEmptyPacket) return;
  if (header.type != kDataPacket)
    file_.source().refuse("points", "a packet of unknown type " + std::to_string(header.type));
  if (header.streams != scan_.fields.size())
    file_.source().refuse("points", "a packet has " + std::to_string(header.streams) + " streams for " +
                                        std::to_string(scan_.fields.size()) + " fields");
  std::vector<std::uint16_t> lengths(header.streams);
  const std::uint64_t lengths_bytes = lengths.size() * sizeof(std::uint16_t);
  if (kPacketHeaderBytes + lengths_bytes > bytes) refuse_truncated();
  file_.read(packet + kPacketHeaderBytes, std::size_t(lengths_bytes), reinterpret_cast<char*>(lengths.data()));
  std::uint64_t offset = packet + kPacketHeaderBytes + lengths_bytes;
  for (std::size_t field = 0; field < lengths.size(); ++field) {
    if (lengths[field] > position_ - offset) refuse_truncated();
    const auto stream = std::find(wanted_.begin(), wanted_.end(), int(field));
    if (stream != wanted_.end()) streams_[std::size_t(stream - wanted_.begin())].append(file_, offset, lengths[field]);
    offset += lengths[field];
  }
}

std::size_t E57Records::next() {
  if (left_ == 0) return 0;
  std::uint64_t count = 0;
  for (;;) {
    count = std::min<std::uint64_t>(left_, kBlock);
    for (const E57Stream& stream : streams_) count = std::min(count, stream.records());
    if (count > 0) break;
    read_packet();
  }
  for (std::size_t k = 0; k < streams_.size(); ++k) {
    columns_[k].resize(std::size_t(count));
    streams_[k].take(std::size_t(count), columns_[k].data());
  }
  left_ -= count;
  return std::size_t(count);
}

std::vector<char> read_e57_blob(PagedFile& file, std::uint64_t physical_offset, std::uint64_t count) {
  const std::uint64_t begin = to_logical(physical_offset);
  if (begin > file.logical_bytes() || file.logical_bytes() - begin < kBlobHeaderBytes ||
      count > file.logical_bytes() - begin - kBlobHeaderBytes)
    file.source().refuse("images2D", "a blob lies beyond the end of the file");
  std::vector<char> bytes(static_cast<std::size_t>(count));
  file.read(begin + kBlobHeaderBytes, bytes.size(), bytes.data());
  return bytes;
}

}  // namespace lapseam
