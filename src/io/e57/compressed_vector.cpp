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
  const std::size_t held = bytes_.empty() ? 0 : bytes_.size() - kPadding;
  const std::size_t used = std::min(used_bits_ / 8, held);
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
  const std::uint64_t held_bits = bytes_.empty() ? 0 : (bytes_.size() - kPadding) * 8;
  return held_bits > used_bits_ ? (held_bits - used_bits_) / std::uint64_t(field_.bits) : 0;
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
  open_section();
  for (const int field : wanted_) streams_.emplace_back(scan.fields[std::size_t(field)]);
  columns_.resize(wanted_.size());
}

E57Records::E57Records(PagedFile& file, const E57Scan& scan, std::vector<int> wanted, const E57Index& index,
                       RecordRange range)
    : file_(file), scan_(scan), wanted_(std::move(wanted)), left_(range.end - range.begin) {
  open_section();
  const std::size_t fields = scan.fields.size(), packets = index.packets.size();
  // The last packet that begins no later than the first record does, in any field.
  std::size_t first = packets;
  for (const int field : wanted_) {
    const std::uint64_t bit = range.begin * std::uint64_t(scan.fields[std::size_t(field)].bits);
    std::size_t low = 0, high = std::min(packets, first + 1);
    while (high - low > 1) {
      const std::size_t middle = (low + high) / 2;
      (index.stream_bytes[middle * fields + std::size_t(field)] * 8 <= bit ? low : high) = middle;
    }
    first = std::min(first, low);
  }
  if (first < packets) position_ = index.packets[first];
  for (const int field : wanted_) {
    const E57Field& packed = scan.fields[std::size_t(field)];
    const std::uint64_t before = first < packets ? index.stream_bytes[first * fields + std::size_t(field)] * 8 : 0;
    streams_.emplace_back(packed, range.begin * std::uint64_t(packed.bits) - before);
  }
  columns_.resize(wanted_.size());
}

void E57Records::open_section() {
  SectionHeader header;
  const std::uint64_t begin = to_logical(scan_.section_offset);
  file_.read(begin, sizeof header, reinterpret_cast<char*>(&header));
  if (header.id != 1) file_.source().refuse("points", "there is no CompressedVector section at its fileOffset");
  position_ = to_logical(header.data_offset);
  end_ = header.section_bytes > file_.logical_bytes() - begin ? file_.logical_bytes() : begin + header.section_bytes;
  std::uint64_t bits = 0;
  for (const E57Field& field : scan_.fields) bits += std::uint64_t(field.bits);
  const std::uint64_t held_bits = position_ < end_ ? (end_ - position_) * 8 : 0;
  if (bits == 0 || scan_.record_count > held_bits / bits)
    file_.source().refuse("points.recordCount",
                          "claims " + std::to_string(scan_.record_count) + " records, more than the section holds");
}

void E57Records::refuse_truncated() const {
  file_.source().refuse("points", "the section ends " + std::to_string(left_) + " records early");
}

template <typename Visit>
bool E57Records::walk_packet(const Visit& visit) {
  PacketHeader header;
  if (position_ + kPacketHeaderBytes > end_) refuse_truncated();
  file_.read(position_, sizeof header, reinterpret_cast<char*>(&header));
  const std::uint64_t bytes = std::uint64_t(header.bytes_minus_1) + 1;
  if (bytes < 4 || bytes > end_ - position_) refuse_truncated();
  const std::uint64_t packet = position_;
  position_ += bytes;
  if (header.type == kIndexPacket || header.type == kEmptyPacket) return false;
  if (header.type != kDataPacket)
    file_.source().refuse("points", "a packet of unknown type " + std::to_string(header.type));
  if (header.streams != scan_.fields.size())
    file_.source().refuse("points", "a packet has " + std::to_string(header.streams) + " streams for " +
                                        std::to_string(scan_.fields.size()) + " fields");
  lengths_.resize(header.streams);
  const std::uint64_t lengths_bytes = lengths_.size() * sizeof(std::uint16_t);
  if (kPacketHeaderBytes + lengths_bytes > bytes) refuse_truncated();
  file_.read(packet + kPacketHeaderBytes, std::size_t(lengths_bytes), reinterpret_cast<char*>(lengths_.data()));
  std::uint64_t offset = packet + kPacketHeaderBytes + lengths_bytes;
  for (std::size_t field = 0; field < lengths_.size(); ++field) {
    if (lengths_[field] > position_ - offset) refuse_truncated();
    visit(field, offset, lengths_[field]);
    offset += lengths_[field];
  }
  return true;
}

void E57Records::read_packet() {
  walk_packet([&](std::size_t field, std::uint64_t offset, std::size_t bytes) {
    const auto stream = std::find(wanted_.begin(), wanted_.end(), int(field));
    if (stream != wanted_.end()) streams_[std::size_t(stream - wanted_.begin())].append(file_, offset, bytes);
  });
}

E57Index index_packets(PagedFile& file, const E57Scan& scan) {
  E57Records records(file, scan, {});
  E57Index index;
  const std::size_t fields = scan.fields.size();
  std::vector<std::uint64_t> sums(fields);
  const auto has_more = [&] {
    std::uint64_t complete = scan.record_count;
    for (std::size_t k = 0; k < fields; ++k)
      if (scan.fields[k].bits > 0) complete = std::min(complete, sums[k] * 8 / std::uint64_t(scan.fields[k].bits));
    records.left_ = scan.record_count - complete;
    return records.left_ > 0;
  };
  while (has_more()) {
    const std::vector<std::uint64_t> before = sums;
    const std::uint64_t packet = records.position_;
    if (!records.walk_packet([&](std::size_t field, std::uint64_t, std::size_t bytes) { sums[field] += bytes; }))
      continue;
    index.packets.push_back(packet);
    index.stream_bytes.insert(index.stream_bytes.end(), before.begin(), before.end());
  }
  return index;
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
