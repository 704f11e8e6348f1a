#include "pecs/files.h"

#include <gtest/gtest.h>

#include "pecs/error.h"

namespace fs = std::filesystem;

class Files : public testing::Test {
 protected:
  void SetUp() override { fs::create_directories(dir_); }
  void TearDown() override { fs::remove_all(dir_); }
  fs::path dir_ = fs::temp_directory_path() / ("pecs_files_" + std::to_string(::getpid()));
};

TEST_F(Files, AppearWholeOrAsPartial) {
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
  fs::create_symlink("/dev/full", dir_ / "b.txt.partial");
  pecs::AtomicFile file(dir_ / "b.txt");
  file.write("x");
  try {
    file.commit();
    FAIL() << "no error";
  } catch (const pecs::Error& e) {
    EXPECT_EQ(e.code(), pecs::ExitCode::bad_output);
  }
  EXPECT_FALSE(fs::exists(dir_ / "b.txt"));
}

TEST_F(Files, Sha256IsTheStandardOne) {  // FIPS 180-2, appendix B.1
  EXPECT_EQ(pecs::sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST_F(Files, MissingAndTooLargeFilesAreNamed) {
  EXPECT_THROW(pecs::read_text(dir_ / "none", 10), pecs::Error);
  pecs::AtomicFile file(dir_ / "c");
  file.write("0123456789abc");
  file.commit();
  EXPECT_THROW(pecs::read_text(dir_ / "c", 10), pecs::Error);
}
