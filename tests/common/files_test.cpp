#include "pecs/files.h"

#include <gtest/gtest.h>

#include "pecs/text.h"
#include "shared.h"

namespace fs = std::filesystem;
using pecs::tests::error_of;

class Files : public testing::Test {
 protected:
  void SetUp() override { fs::create_directories(dir_); }
  void TearDown() override { fs::remove_all(dir_); }
  fs::path dir_ = fs::temp_directory_path() / ("pecs_files_" + std::to_string(::getpid()));
};

TEST_F(Files, AreCompleteOrPartial) {
  const fs::path path = dir_ / "a.txt";
  {
    pecs::AtomicFile file(path);
    file.write("half");
  }
  EXPECT_FALSE(fs::exists(path));
  EXPECT_TRUE(fs::exists(pecs::partial_path(path)));
  {
    pecs::AtomicFile file(path);
    file.write("whole");
    file.commit();
  }
  EXPECT_EQ(pecs::read_text(path, 100), "whole");
  EXPECT_FALSE(fs::exists(pecs::partial_path(path)));
}

TEST_F(Files, AFullDiskIsAnError) {
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "needs /dev/full";
  fs::create_symlink("/dev/full", dir_ / "b.txt");
  pecs::AtomicFile file(dir_ / "b.txt");
  file.write("x");
  pecs::tests::expect_error([&] { file.commit(); }, pecs::ExitCode::bad_output, "b.txt");
  EXPECT_TRUE(fs::is_symlink(dir_ / "b.txt")) << "written through, not replaced";
}

TEST_F(Files, Sha256IsTheStandardOne) {
  const auto hash = [&](const std::string& text) {
    pecs::write_file(dir_ / "text", text);
    return pecs::sha256_of_file(dir_ / "text");
  };
  // FIPS 180-2, appendix B
  EXPECT_EQ(hash(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(hash("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(hash("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  EXPECT_EQ(hash(std::string(1'000'000, 'a')), "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
  // The hash of the hashes of every length up to three blocks, by Python's hashlib.
  std::string all;
  for (int length = 0; length <= 200; ++length) {
    std::string text;
    for (int i = 0; i < length; ++i) text += static_cast<char>((i * 7 + length) % 251);
    all += hash(text);
  }
  EXPECT_EQ(hash(all), "22c7fad6d297c3a674934039e445c8d8b2dc25f6636af76279787fdf3463b15c");
}

TEST(Text, Base64IsTheStandardOne) {  // RFC 4648, section 10
  const auto of = [](std::string_view text) {
    return pecs::base64({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  };
  EXPECT_EQ(of(""), "");
  EXPECT_EQ(of("f"), "Zg==");
  EXPECT_EQ(of("fo"), "Zm8=");
  EXPECT_EQ(of("foo"), "Zm9v");
  EXPECT_EQ(of("foobar"), "Zm9vYmFy");
  EXPECT_EQ(of("\xfb\xff\xfe"), "+//+");
}

TEST_F(Files, TextHasNoByteOrderMark) {
  pecs::write_file(dir_ / "a", "\xef\xbb\xbf{}");
  EXPECT_EQ(pecs::read_text(dir_ / "a", 10), "{}");
}

TEST_F(Files, MissingAndTooLargeFilesAreNamed) {
  EXPECT_THROW(pecs::read_text(dir_ / "none", 10), pecs::Error);
  pecs::AtomicFile file(dir_ / "c");
  file.write("0123456789abc");
  file.commit();
  EXPECT_THROW(pecs::read_text(dir_ / "c", 10), pecs::Error);
}

TEST_F(Files, OneWriterAtATime) {
  const fs::path path = dir_ / "d";
  pecs::AtomicFile first(path);
  first.write("first");
  EXPECT_NE(error_of([&] { pecs::AtomicFile second(path); }).find("another process"), std::string::npos);
  first.commit();
  EXPECT_EQ(pecs::read_text(path, 10), "first");
  pecs::AtomicFile third(path);
  third.commit();
  EXPECT_EQ(fs::file_size(path), 0u);
}

TEST_F(Files, SpecialFilesAreErrors) {
  fs::create_directory(dir_ / "folder");
  std::error_code no_links;
  fs::create_symlink("nothing", dir_ / "dangling", no_links);
  if (no_links) GTEST_SKIP() << "no symbolic links here";
  fs::create_symlink("loop", dir_ / "loop");
  fs::create_symlink("c", dir_ / "e.partial");
  fs::create_directory(dir_ / "f.partial");
  for (const char* name : {"folder", "dangling", "loop", "e", "f", "none/x"})
    EXPECT_NE(error_of([&] { pecs::AtomicFile file(dir_ / name); }).find("cannot be written"), std::string::npos)
        << name;
  EXPECT_NE(error_of([&] { pecs::AtomicFile file(""); }), "");
}

TEST_F(Files, OutputsAreNeitherInputsNorDuplicates) {
  const auto write = [&](const std::string& name) {
    pecs::AtomicFile file(dir_ / name);
    file.commit();
    return dir_ / name;
  };
  const fs::path input = write("in"), frame = write("frame_000000.exr"), old = write("old.raw");
  fs::create_hard_link(input, dir_ / "same");
  EXPECT_NE(error_of([&] { pecs::check_outputs({input}, {input}); }).find("the input itself"), std::string::npos);
  EXPECT_NE(error_of([&] { pecs::check_outputs({input}, {dir_ / "same"}); }), "");
  EXPECT_NE(error_of([&] { pecs::check_outputs({write("x.partial")}, {dir_ / "x"}); }), "");
  EXPECT_NE(error_of([&] { pecs::check_outputs({input}, {dir_ / "new", dir_ / "." / "new"}); }), "");
  EXPECT_NE(error_of([&] { pecs::check_outputs({dir_}, {frame}); }).find("input folder"), std::string::npos);
  EXPECT_EQ(error_of([&] { pecs::check_outputs({input, dir_}, {old, dir_ / "new", "", ""}); }), "");
}

TEST(Errors, AreOneLineOfPrintableText) {
  const std::string line =
      pecs::bad_input("a\nb\x1b[31m", "", std::string("\0\xff\xc3", 3), "\xc2\x9b \xc3\xa9\xe2\x82\xac").what();
  EXPECT_EQ(line, "a\\x0ab\\x1b[31m: got \\x00\\xff\\xc3, wanted \\xc2\\x9b \xc3\xa9\xe2\x82\xac");
  EXPECT_EQ(pecs::shortened("\xc3\xa9\xc3\xa9", 3), "\xc3\xa9...");
  EXPECT_EQ(pecs::shortened("abc", 3), "abc");
}
