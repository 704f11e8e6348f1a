#include "pecs/files.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <memory>
#include <utility>

#include "pecs/error.h"
#include "pecs/text.h"
#include "sha256.h"

namespace pecs {
namespace fs = std::filesystem;
namespace {

constexpr std::string_view kFrameEndings[] = {".json", ".exr", ".png",  ".tif", ".tiff", ".jpg",
                                              ".jpeg", ".bmp", ".webp", ".pgm", ".ppm"};

std::string last_error() { return std::strerror(errno); }

struct FileCloser {
  void operator()(std::FILE* f) const { std::fclose(f); }
};
using FilePtr = std::unique_ptr<std::FILE, FileCloser>;

// Also for paths that do not exist yet.
bool is_same_file(const fs::path& a, const fs::path& b) {
  std::error_code ec;
  if (fs::equivalent(a, b, ec)) return true;
  const fs::path a_path = fs::weakly_canonical(a, ec), b_path = ec ? fs::path() : fs::weakly_canonical(b, ec);
  return !ec && a_path == b_path;
}

// Resolves links in an output's path. Throws bad_output for an existing path that is not a file or a stream.
fs::path file_behind(const fs::path& path) {
  if (path.empty()) throw bad_output("output", "the path is empty");
  std::error_code ec;
  switch (fs::status(path, ec).type()) {
    case fs::file_type::not_found:
      if (fs::is_symlink(path, ec)) throw bad_output(path.string(), "dangling symbolic link");
      return path;
    case fs::file_type::regular:
      return fs::is_symlink(path) ? fs::canonical(path) : path;
    case fs::file_type::directory:
      throw bad_output(path.string(), "it is a directory");
    case fs::file_type::fifo:
    case fs::file_type::character:
      throw bad_output(path.string(), "it is a pipe or a device; this format needs a seekable file");
    case fs::file_type::none:
      throw bad_output(path.string(), ec.message());
    default:
      throw bad_output(path.string(), "it is a block device or a socket");
  }
}

FilePtr open_to_read(const fs::path& path) {
  if (fs::is_directory(path)) throw not_found(path.string(), "it is a directory");
  FilePtr f(platform::open_to_read(path));
  if (!f) throw not_found(path.string(), last_error());
  return f;
}

}  // namespace

PartialFile::PartialFile(const fs::path& path, bool keeps_extension)
    : path_(file_behind(path)),
      partial_(keeps_extension ? path_.parent_path() /
                                     fmt::format(".{}.partial{}", path_.stem().string(), path.extension().string())
                               : pecs::partial_path(path_)),
      file_(platform::claim(partial_, path)) {}

void PartialFile::commit() {
  if (const std::string why = platform::rename_complete(file_, partial_, path_); !why.empty())
    throw bad_output(path_.string(), why);
  file_ = {};  // Windows replaces no file that is open
}

void PartialFile::commit(const fs::path& written) {
  if (const std::string why = platform::rename_complete(written, path_); !why.empty())
    throw bad_output(path_.string(), why);
  std::error_code ec;
  fs::remove(partial_, ec);
}

AtomicFile::AtomicFile(const fs::path& path, Order order) : path_(path) {
  file_ = order == Order::front_to_back && is_stream(path) ? platform::open_stream(path)
                                                           : platform::open_again(partial_.emplace(path).file());
  if (!file_) throw bad_output(path.string(), last_error());
}

AtomicFile::~AtomicFile() {
  if (file_) std::fclose(file_);
}

void AtomicFile::write(std::span<const std::byte> bytes) {
  if (std::fwrite(bytes.data(), 1, bytes.size(), file_) != bytes.size()) throw bad_output(path_.string(), last_error());
}

void AtomicFile::write(std::string_view text) { write(std::as_bytes(std::span(text))); }

void AtomicFile::seek(std::uint64_t offset) {
  if (fseeko(file_, static_cast<off_t>(offset), SEEK_SET) != 0) throw bad_output(path_.string(), last_error());
}

void AtomicFile::commit() {
  if (std::fflush(file_) != 0) throw bad_output(path_.string(), last_error());
  if (partial_) partial_->commit();
  if (std::fclose(std::exchange(file_, nullptr)) != 0) throw bad_output(path_.string(), last_error());
}

void write_file(const fs::path& path, std::span<const std::byte> bytes) {
  AtomicFile file(path);
  file.write(bytes);
  file.commit();
}

void write_file(const fs::path& path, std::string_view text) { write_file(path, std::as_bytes(std::span(text))); }

fs::path partial_path(const fs::path& path) {
  fs::path partial = path;
  partial += ".partial";
  return partial;
}

fs::path run_record_path(const fs::path& output) { return output.string() + ".run.json"; }

bool is_stream(const fs::path& path) {
  std::error_code ec;
  const fs::file_status found = fs::status(path, ec);
  return fs::is_fifo(found) || fs::is_character_file(found);
}

void check_outputs(const std::vector<fs::path>& inputs, const std::vector<fs::path>& outputs) {
  const auto replaces = [](const fs::path& output, const fs::path& file) {
    return is_same_file(output, file) || is_same_file(pecs::partial_path(output), file) ||
           is_same_file(run_record_path(output), file);
  };
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    const fs::path& output = outputs[i];
    if (output.empty() || is_stream(output)) continue;
    const auto refuse = [&](const std::string& got, const std::string& wanted) {
      return bad_usage(output.string() + ": output", got, wanted);
    };
    for (const fs::path& input : inputs) {
      if (input.empty()) continue;
      if (replaces(output, input)) throw refuse("the input itself", "another file");
      if (fs::exists(output) && is_same_file(output.parent_path() / ".", input / ".") &&
          std::ranges::find(kFrameEndings, lower(output.extension().string())) != std::end(kFrameEndings))
        throw refuse("a file of the input folder", "another file");
    }
    for (std::size_t k = 0; k < i; ++k)
      if (!outputs[k].empty() && !is_stream(outputs[k]) &&
          (replaces(output, outputs[k]) || replaces(outputs[k], output)))
        throw refuse("two outputs", "one file each");
  }
}

namespace {

// Calls visit(bytes) for each part of a file.
template <class Visit>
void read_file(const fs::path& path, const Visit& visit) {
  const FilePtr f = open_to_read(path);
  std::array<char, 1 << 16> buffer{};
  while (!std::feof(f.get())) {
    const std::size_t n = std::fread(buffer.data(), 1, buffer.size(), f.get());
    if (std::ferror(f.get())) throw not_found(path.string(), std::strerror(errno));
    visit(std::string_view(buffer.data(), n));
  }
}

}  // namespace

std::string read_text(const fs::path& path, std::size_t max_bytes) {
  std::string text;
  read_file(path, [&](std::string_view bytes) {
    text += bytes;
    if (text.size() > max_bytes)
      throw bad_input(path.string(), "", "more than " + std::to_string(max_bytes) + " bytes",
                      "at most " + std::to_string(max_bytes));
  });
  if (text.starts_with("\xef\xbb\xbf")) text.erase(0, 3);  // a byte order mark
  return text;
}

std::string sha256_of_file(const fs::path& path) {
  Sha256 hash;
  read_file(path, [&](std::string_view bytes) { hash.add(bytes); });
  return hash.hex();
}

}  // namespace pecs
