#include <charconv>
#include <cstdio>
#include <memory>
#include <string>

#include "io/mesh_formats.h"
#include "io/output_file.h"
#include "io/page_codec.h"
#include "io/weld_corners.h"
#include "lapseam/error.h"

namespace lapseam {
namespace {

/// Appends words to a line, each number with as few digits as bring it back exactly.
class Line {
 public:
  explicit Line(std::string_view keyword) : text_(keyword) {}
  template <typename Number>
  Line& add(Number value) {
    char digits[32];
    text_ += ' ';
    text_.append(digits, std::to_chars(digits, digits + sizeof digits, value).ptr);
    return *this;
  }
  std::string_view end() {
    text_ += '\n';
    return text_;
  }
  std::string& text() { return text_; }

 private:
  std::string text_;
};

std::string material_name(const WeldedPage& welded) {
  const std::uint32_t page = welded.page;
  if (page == kInvalidIndex) return welded.is_unseen ? "unseen" : "vertex_colors";
  char name[24];
  std::snprintf(name, sizeof name, "page_%03u", page);
  return name;
}

void write_vertices(const Mesh& mesh, OutputFile& out) {
  const bool has_origin = !mesh.origin_m.isZero(0);
  for (std::size_t i = 0; i < mesh.vertex_count(); ++i) {
    const Eigen::Vector3f& p = mesh.positions_m[i];
    Line line("v");
    for (int axis = 0; axis < 3; ++axis)
      has_origin ? line.add(mesh.origin_m[axis] + double(p[axis])) : line.add(p[axis]);
    if (!mesh.colors.empty()) {
      const Rgb8 c = mesh.colors[i];
      for (const std::uint8_t channel : {c.r, c.g, c.b}) line.add(float(channel) / 255.0f);
    }
    out.write(line.end());
  }
}

/// texcoord_base: number of vt lines before this page's. Numbers in OBJ begin at 1.
void write_faces(const WeldedPage& page, std::size_t texcoord_base, OutputFile& out) {
  for (const Eigen::Vector2f& uv : page.texcoords) out.write(Line("vt").add(uv.x()).add(1.0f - uv.y()).end());
  for (std::size_t i = 0; i < page.indices.size(); i += 3) {
    Line line("f");
    for (std::size_t corner = i; corner < i + 3; ++corner) {
      const std::uint32_t welded = page.indices[corner];
      line.add(std::uint64_t(page.vertices[welded]) + 1);
      if (!page.texcoords.empty()) line.text() += "/" + std::to_string(texcoord_base + welded + 1);
    }
    out.write(line.end());
  }
}

/// The materials and page images of one OBJ file, still under temporary names.
class MaterialFiles {
 public:
  MaterialFiles(const std::filesystem::path& obj_file, const WriteMeshOptions& options)
      : obj_file_(obj_file), options_(options) {
    std::filesystem::path file = obj_file;
    file.replace_extension(".mtl");
    name_ = file.filename().string();
    materials_ = std::make_unique<OutputFile>(file);
    materials_->write("# written by lapseam\n");
  }

  const std::string& name() const { return name_; }

  void add(const Mesh& mesh, const WeldedPage& welded) {
    const std::uint32_t page = welded.page;
    const std::string material = material_name(welded);
    // Without Kd, the untextured material says no more than that: nothing is known about its colour.
    materials_->write("\nnewmtl " + material + "\nillum 0\n");
    if (page == kInvalidIndex) return;
    std::filesystem::path file = obj_file_;
    file.replace_filename(obj_file_.stem().string() + "_" + material + file_ending(options_.texture_format));
    materials_->write("Kd 1 1 1\nmap_Kd " + file.filename().string() + "\n");
    images_.push_back(std::make_unique<OutputFile>(file));
    const std::vector<char> bytes = encode_page(mesh.pages[page], options_.texture_format, options_.texture_quality);
    images_.back()->write(bytes.data(), bytes.size());
    images_.back()->close();
  }

  void close() { materials_->close(); }
  void commit() {
    for (const auto& image : images_) image->commit();
    materials_->commit();
  }

 private:
  std::filesystem::path obj_file_;
  const WriteMeshOptions& options_;
  std::string name_;
  std::unique_ptr<OutputFile> materials_;
  std::vector<std::unique_ptr<OutputFile>> images_;
};

}  // namespace

void write_obj(const Mesh& mesh, const std::filesystem::path& file, const WriteMeshOptions& options) {
  if (options.texture_format == TextureFormat::kWebp)
    throw InvalidInput(file, {}, "texture format", "an OBJ's materials are JPEG or PNG: WebP is read by few programs");
  const std::vector<WeldedPage> pages = weld_corners(mesh);
  OutputFile out(file);
  out.write("# written by lapseam; metres\n");
  std::unique_ptr<MaterialFiles> materials;
  if (!pages.empty() && pages.front().page != kInvalidIndex) {
    materials = std::make_unique<MaterialFiles>(file, options);
    out.write("mtllib " + materials->name() + "\n");
  }
  write_vertices(mesh, out);
  std::size_t texcoord_count = 0;
  for (const WeldedPage& page : pages) {
    if (materials) {
      materials->add(mesh, page);
      out.write("usemtl " + material_name(page) + "\n");
    }
    write_faces(page, texcoord_count, out);
    texcoord_count += page.texcoords.size();
  }
  out.close();
  if (materials) {
    // What the others name comes first, so that no file ever points at one that is not there yet.
    materials->close();
    materials->commit();
  }
  out.commit();
}

}  // namespace lapseam
