// SPDX-License-Identifier: Apache-2.0
#include "tests/tools/cli_testing.h"

namespace mtdb::test {

std::string ReadText(const std::string& path) {
  if (!std::filesystem::is_regular_file(path)) return "";
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

void WriteText(const std::string& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

bool Exists(const std::string& path) { return std::filesystem::exists(path); }

pid_t Start(const Arguments& arguments, const std::string& out, const std::string& err) {
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

Outcome Finish(pid_t process) {
  int status = 0;
  REQUIRE(::waitpid(process, &status, 0) == process);
  Outcome outcome;
  if (WIFEXITED(status)) outcome.exit_code = WEXITSTATUS(status);
  if (WIFSIGNALED(status)) outcome.signal = WTERMSIG(status);
  return outcome;
}

Outcome Run(const Arguments& arguments) {
  const Folder folder;
  const std::string out = folder.File("out");
  const std::string err = folder.File("err");
  Outcome outcome = Finish(Start(arguments, out, err));
  outcome.out = ReadText(out);
  outcome.err = ReadText(err);
  return outcome;
}

std::string Join(const Arguments& arguments) {
  std::string line = "mtdb";
  for (const std::string& a : arguments) line += " " + a;
  return line;
}

bool IsOneLine(const std::string& text) {
  return text.starts_with("mtdb: ") && text.size() > 10 && text.find('\n') == text.size() - 1;
}

std::string RunOk(const Arguments& arguments) {
  const Outcome outcome = Run(arguments);
  INFO(Join(arguments) << "\nexit " << outcome.exit_code << ", signal " << outcome.signal << "\n"
                       << outcome.err);
  REQUIRE(outcome.exit_code == 0);
  return outcome.out;
}

Json RunJson(Arguments arguments) {
  arguments.push_back("--json");
  const Outcome outcome = Run(arguments);
  INFO(Join(arguments) << "\nexit " << outcome.exit_code << ", signal " << outcome.signal << "\n"
                       << outcome.err << outcome.out);
  REQUIRE(outcome.exit_code == 0);
  REQUIRE(outcome.err.empty());
  return ParseJson(outcome.out);
}

void RunFails(int exit_code, const Arguments& arguments, const Arguments& words) {
  const Outcome outcome = Run(arguments);
  INFO(Join(arguments) << "\nexit " << outcome.exit_code << ", signal " << outcome.signal << "\n"
                       << outcome.err << outcome.out);
  CHECK(outcome.exit_code == exit_code);
  CHECK(outcome.out.empty());
  CHECK(IsOneLine(outcome.err));
  for (const std::string& word : words) CHECK_THAT(outcome.err, Catch::Contains(word));
}

const Example& TheExample() {
  static const Example kExample(20000);
  return kExample;
}

const Example& SmallExample() {
  static const Example kExample(2000);
  return kExample;
}

Example::Example(int triangles) {
  RunOk({"generate", "sculpture", mesh, "--triangles", std::to_string(triangles)});
  RunOk({"ingest", mesh, store, "--quiet"});
  RunOk({"extract", store, full});
  info = RunJson({"info", store}).at("objects").at(0);
}

}  // namespace mtdb::test
