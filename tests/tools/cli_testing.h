// SPDX-License-Identifier: Apache-2.0
// The mtdb binary as a process, for tests of the command line.
#pragma once

#include <algorithm>
#include <catch2/catch.hpp>
#include <cstdint>
#include <cstdlib>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

#include "codecs/mesh_file/mesh_file.h"
#include "store/base/mesh_sink.h"
#include "tests/support/json.h"
#include "tests/support/read_mesh.h"
#include "tests/support/temporary_folder.h"

template <>
struct Catch::StringMaker<nlohmann::json> {
  static std::string convert(const nlohmann::json& json) { return mtdb::test::TextOf(json); }
};

namespace mtdb::test {

using Arguments = std::vector<std::string>;
using testing::ReadMesh;

// Files of one test case; removed with it.
class Folder {
 public:
  std::string File(const std::string& name) const { return folder_.path() + "/" + name; }

 private:
  mtdb::testing::TemporaryFolder folder_;
};

// Empty when it is no file.
std::string ReadText(const std::string& path);

void WriteText(const std::string& path, const std::string& text);

bool Exists(const std::string& path);

struct Outcome {
  int exit_code = -1;  // -1: a signal ended it
  int signal = 0;
  std::string out, err;
};

constexpr unsigned kTimeoutSeconds = 240;  // then SIGALRM ends the process

// Starts mtdb; `out` and `err` are files for what it prints.
pid_t Start(const Arguments& arguments, const std::string& out, const std::string& err);

// Waits for the process's end. What it printed is not in the answer.
Outcome Finish(pid_t process);

Outcome Run(const Arguments& arguments);

std::string Join(const Arguments& arguments);

// One line that begins with the program's name.
bool IsOneLine(const std::string& text);

// Must succeed; what it prints on standard output.
std::string RunOk(const Arguments& arguments);

// Must succeed and print JSON and nothing else.
Json RunJson(Arguments arguments);

// Must fail with `exit_code`, print one line on standard error that has all of `words`, and
// nothing on standard output.
void RunFails(int exit_code, const Arguments& arguments, const Arguments& words);

// A mesh and the store that it is in, made once for all tests that only read.
struct Example {
  Folder folder;
  std::string mesh = folder.File("sculpture.ply");
  std::string store = folder.File("sculpture.mtdb");
  std::string full = folder.File("full.ply");  // extract --full of it
  Json info;                                   // of the only object

  explicit Example(int triangles);
  double step() const { return info.at("step").get<double>(); }
};

// Of about 20,000 and 2,000 triangles.
const Example& TheExample();
const Example& SmallExample();

}  // namespace mtdb::test
