#include "io/e57/paged_file.h"

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstring>
#include <system_error>

#include "core/parallel.h"
#include "core/crc32c.h"

namespace lapseam {
namespace {

static_assert(std::endian::native == std::endian::little, "E57 files are little-endian and are read in place");

constexpr std::size_t kHeaderBytes = 48;

struct Header {
  char signature[8];
  std::uint32_t major, minor;
  std::uint64_t file_bytes, xml_offset, xml_bytes, page_bytes;
};
static_assert(sizeof(Header) == kHeaderBytes);

void check_header(const Source& source, const Header& header, std::uint64_t file_bytes) {
  if (std::memcmp(header.signature, "ASTM-E57", 8) != 0) source.refuse("signature", "this is no E57 file");
  if (header.major != 1)
    source.refuse("version",
                  std::to_string(header.major) + "." + std::to_string(header.minor) + " is not read; 1.x is");
  if (header.page_bytes != kE57PageBytes)
    source.refuse("pageSize", "is " + std::to_string(header.page_bytes) + "; the standard has 1024");
  if (header.file_bytes > file_bytes)
    source.refuse("filePhysicalLength", "claims " + std::to_string(header.file_bytes) + " bytes, the file has " +
                                            std::to_string(file_bytes) + ": it is truncated");
}

}  // namespace

PagedFile::PagedFile(const Source& source, std::uint64_t block_pages)
    : source_(source), file_(std::fopen(source.file.c_str(), "rb")), most_block_pages_(block_pages) {
  if (!file_) throw IoError(source.file, "cannot read: " + std::generic_category().message(errno));
  const std::uint64_t file_bytes = file_size_bytes(source.file);
  if (file_bytes < kE57PageBytes)
    source.refuse({}, "of " + std::to_string(file_bytes) + " bytes is shorter than one page of an E57 file");
  Header header;
  if (std::fread(&header, 1, sizeof header, file_.get()) != sizeof header) throw IoError(source.file, "cannot read");
  check_header(source, header, file_bytes);
  pages_ = std::min(header.file_bytes, file_bytes) / kE57PageBytes;
  xml_offset_ = header.xml_offset;
  xml_bytes_ = header.xml_bytes;
}

std::string PagedFile::read_xml() {
  const std::uint64_t begin = to_logical(xml_offset_);
  if (xml_offset_ % kE57PageBytes >= kE57PayloadBytes || begin > logical_bytes() ||
      xml_bytes_ > logical_bytes() - begin)
    source_.refuse("xmlLogicalLength", "the XML section lies beyond the end of the file");
  std::string xml(std::size_t(xml_bytes_), '\0');
  read(begin, xml.size(), xml.data());
  return xml;
}

void PagedFile::load_block(std::uint64_t first_page) {
  const std::uint64_t count = std::min(most_block_pages_, pages_ - first_page);
  block_.resize(std::size_t(count * kE57PageBytes));
  block_bytes_ = 0;
  if (fseeko(file_.get(), off_t(first_page * kE57PageBytes), SEEK_SET) != 0 ||
      std::fread(block_.data(), 1, block_.size(), file_.get()) != block_.size())
    throw IoError(source_.file, "cannot read page " + std::to_string(first_page));
  for (std::uint64_t i = 0; i < count; ++i) {
    char* page = block_.data() + i * kE57PageBytes;
    std::uint32_t stored;
    std::memcpy(&stored, page + kE57PayloadBytes, sizeof stored);
    if (__builtin_bswap32(stored) != crc32c(page, kE57PayloadBytes))
      source_.refuse("page " + std::to_string(first_page + i), "the checksum is wrong: the file is damaged");
    std::memmove(block_.data() + i * kE57PayloadBytes, page, kE57PayloadBytes);
  }
  block_page_ = first_page;
  block_bytes_ = count * kE57PayloadBytes;
}

void PagedFile::read(std::uint64_t logical_offset, std::size_t count, char* out) {
  if (logical_offset > logical_bytes() || count > logical_bytes() - logical_offset)
    source_.refuse({}, "a section lies beyond the end of the file");
  while (count > 0) {
    const std::uint64_t begin = block_page_ * kE57PayloadBytes;
    if (logical_offset < begin || logical_offset >= begin + block_bytes_) {
      load_block(logical_offset / kE57PayloadBytes);
      continue;
    }
    const std::uint64_t at = logical_offset - begin;
    const std::size_t piece = std::min<std::size_t>(count, std::size_t(block_bytes_ - at));
    std::memcpy(out, block_.data() + at, piece);
    out += piece;
    count -= piece;
    logical_offset += piece;
  }
}

void PagedFile::check(std::uint64_t first_page, std::uint64_t count) {
  for (std::uint64_t page = first_page; page < first_page + count; page += block_bytes_ / kE57PayloadBytes)
    load_block(page);
}

void check_e57_pages(const Source& source, Context& context) {
  constexpr std::size_t kPages = 8192;
  const std::size_t pages = PagedFile(source).pages();
  parallel_blocks(context, pages, kPages, [&](std::size_t begin, std::size_t end) {
    PagedFile file(source);
    file.check(begin, std::min(end, std::size_t(file.pages())) - begin);
  });
}

}  // namespace lapseam
