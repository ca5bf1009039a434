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
#include <nlohmann/json.hpp>
#include <string>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

#include "codecs/mesh_file/mesh_file.h"
#include "store/base/mesh_sink.h"
#include "tests/support/read_mesh.h"
#include "tests/support/temporary_folder.h"

namespace mtdb::test {

using Json = nlohmann::json;
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
inline std::string ReadText(const std::string& path) {
  if (!std::filesystem::is_regular_file(path)) return "";
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

inline void WriteText(const std::string& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

inline bool Exists(const std::string& path) { return std::filesystem::exists(path); }

struct Outcome {
  int exit_code = -1;  // -1: a signal ended it
  int signal = 0;
  std::string out, err;
};

constexpr unsigned kTimeoutSeconds = 240;  // then SIGALRM ends the process

// Starts mtdb; `out` and `err` are files for what it prints.
inline pid_t Start(const Arguments& arguments, const std::string& out, const std::string& err) {
  std::vector<char*> argv{const_cast<char*>(MTDB_BINARY)};
  for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
  argv.push_back(nullptr);
  const pid_t child = ::fork();
  REQUIRE(child >= 0);
  if (child != 0) return child;
  const int out_file = ::open(out.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  const int err_file = ::open(err.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  if (out_file < 0 || err_file < 0 || ::dup2(out_file, 1) < 0 || ::dup2(err_file, 2) < 0) {
    ::_exit(126);
  }
  // A campaign takes longer.
  const char* soak = std::getenv("MTDB_SOAK_SECONDS");
  ::alarm(kTimeoutSeconds + static_cast<unsigned>(soak == nullptr ? 0 : std::atoi(soak)));
  ::execv(MTDB_BINARY, argv.data());
  ::_exit(127);
}

// Waits for the process's end. What it printed is not in the answer.
inline Outcome Finish(pid_t process) {
  int status = 0;
  REQUIRE(::waitpid(process, &status, 0) == process);
  Outcome outcome;
  if (WIFEXITED(status)) outcome.exit_code = WEXITSTATUS(status);
  if (WIFSIGNALED(status)) outcome.signal = WTERMSIG(status);
  return outcome;
}

inline Outcome Run(const Arguments& arguments) {
  const Folder folder;
  const std::string out = folder.File("out");
  const std::string err = folder.File("err");
  Outcome outcome = Finish(Start(arguments, out, err));
  outcome.out = ReadText(out);
  outcome.err = ReadText(err);
  return outcome;
}

inline std::string Join(const Arguments& arguments) {
  std::string line = "mtdb";
  for (const std::string& a : arguments) line += " " + a;
  return line;
}

// One line that begins with the program's name.
inline bool IsOneLine(const std::string& text) {
  return text.starts_with("mtdb: ") && text.size() > 10 && text.find('\n') == text.size() - 1;
}

// Must succeed; what it prints on standard output.
inline std::string RunOk(const Arguments& arguments) {
  const Outcome outcome = Run(arguments);
  INFO(Join(arguments) << "\nexit " << outcome.exit_code << ", signal " << outcome.signal << "\n"
                       << outcome.err);
  REQUIRE(outcome.exit_code == 0);
  return outcome.out;
}

// Must succeed and print JSON and nothing else.
inline Json RunJson(Arguments arguments) {
  arguments.push_back("--json");
  const Outcome outcome = Run(arguments);
  INFO(Join(arguments) << "\nexit " << outcome.exit_code << ", signal " << outcome.signal << "\n"
                       << outcome.err << outcome.out);
  REQUIRE(outcome.exit_code == 0);
  REQUIRE(outcome.err.empty());
  return Json::parse(outcome.out);
}

// Must fail with `exit_code`, print one line on standard error that has all of `words`, and
// nothing on standard output.
inline void RunFails(int exit_code, const Arguments& arguments, const Arguments& words) {
  const Outcome outcome = Run(arguments);
  INFO(Join(arguments) << "\nexit " << outcome.exit_code << ", signal " << outcome.signal << "\n"
                       << outcome.err << outcome.out);
  CHECK(outcome.exit_code == exit_code);
  CHECK(outcome.out.empty());
  CHECK(IsOneLine(outcome.err));
  for (const std::string& word : words) CHECK_THAT(outcome.err, Catch::Contains(word));
}

// A mesh and the store that it is in, made once for all tests that only read.
struct Example {
  Folder folder;
  std::string mesh = folder.File("sculpture.ply");
  std::string store = folder.File("sculpture.mtdb");
  std::string full = folder.File("full.ply");  // extract --full of it
  Json info;                                   // of the only object

  explicit Example(int triangles) {
    RunOk({"generate", "sculpture", mesh, "--triangles", std::to_string(triangles)});
    RunOk({"ingest", mesh, store, "--quiet"});
    RunOk({"extract", store, full});
    info = RunJson({"info", store}).at("objects").at(0);
  }
  double step() const { return info.at("step").get<double>(); }
};

// Of about 20,000 and 2,000 triangles.
inline const Example& TheExample() {
  static const Example kExample(20000);
  return kExample;
}
inline const Example& SmallExample() {
  static const Example kExample(2000);
  return kExample;
}

}  // namespace mtdb::test
