// SPDX-License-Identifier: Apache-2.0
// The commands of the documents, one after the other, as a reader runs them.
#include <catch2/catch.hpp>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include "tests/tools/http_testing.h"

namespace mtdb::test {
namespace {

// Lines that are indented by four and begin with a program's name, or set variables for it; a
// backslash at the end goes on.
std::vector<std::string> CommandsOf(const std::string& document) {
  std::ifstream in(std::string(MTDB_SOURCE_DIR) + "/" + document);
  REQUIRE(in.is_open());
  std::vector<std::string> commands;
  for (std::string line; std::getline(in, line);) {
    if (!line.starts_with("    mtdb ") && !line.starts_with("    curl ") &&
        !line.starts_with("    AWS_")) {
      continue;
    }
    std::string command = line.substr(4), more;
    while (command.ends_with('\\') && std::getline(in, more)) {
      command.pop_back();
      command += more;
    }
    commands.push_back(command);
  }
  return commands;
}

void Replace(std::string* text, const std::string& from, const std::string& to) {
  for (size_t at = text->find(from); at != std::string::npos; at = text->find(from, at)) {
    text->replace(at, from.size(), to);
    at += to.size();
  }
}

// Runs a command in the folder. What serves is told to end once it has said its URL.
void RunAsPrinted(const Folder& folder, std::string command) {
  INFO(command);
  const std::string program(MTDB_BINARY);
  std::string script = "cd " + folder.File("") +
                       " && export PATH=" + program.substr(0, program.rfind('/')) +
                       ":$PATH && set -e -o pipefail\n";
  if (command.starts_with("mtdb serve") ||
      (command.starts_with("mtdb view") && command.find("--write-page") == std::string::npos)) {
    command = command.substr(0, command.find(" #"));
    Replace(&command, " --listen 127.0.0.1:8080", "");
    command += command.starts_with("mtdb view") ? " --no-browser" : " --listen 127.0.0.1:0";
    script += command +
              " > url & p=$!\n"
              "until [ -s url ]; do kill -0 $p; sleep 0.05; done\n"
              "kill -INT $p; wait $p; rm url\n";
  } else {
    script += command + "\n";
  }
  WriteText(folder.File("command.sh"), script);
  const int status = std::system(
      ("timeout 200 bash " + folder.File("command.sh") + " > " + folder.File("said") + " 2>&1")
          .c_str());
  const std::string said = ReadText(folder.File("said"));
  if (said.find("was built without the viewer") != std::string::npos) {
    WARN("skipped: " << command << ": no viewer in builds for sanitizers");
    std::filesystem::create_directory(folder.File("www"));  // where the next ones put their files
    return;
  }
  INFO(said);
  CHECK(status == 0);
}

void MakeScan(const Folder& folder) {
  RunOk({"generate", "sculpture", folder.File("scan.ply"), "--triangles", "5000"});
  // Neighbours of 11 x 11 heights.
  for (const char* const tile : {"N37W120.hgt", "N38W120.hgt"}) {
    std::string bytes;
    for (int i = 0; i < 121; ++i) bytes += {'\x04', static_cast<char>(i % 7)};
    WriteText(folder.File(tile), bytes);
  }
}

// What the guide compares: a scan, and a terrain, each beside itself on another grid.
void MakePairs(const Folder& folder) {
  RunOk({"generate", "sculpture", folder.File("pair.ply"), "--triangles", "5000"});
  RunOk({"generate", "terrain", folder.File("hills.ply"), "--triangles", "5000"});
  for (const auto& [mesh, store, bits] : {std::array{"pair.ply", "before.mtdb", "16"},
                                          {"pair.ply", "after.mtdb", "20"},
                                          {"hills.ply", "may.mtdb", "16"},
                                          {"hills.ply", "june.mtdb", "20"}}) {
    Arguments arguments{"ingest", folder.File(mesh), folder.File(store), "--bits", bits};
    if (mesh == std::string("hills.ply")) arguments.push_back("--terrain");
    RunOk(arguments);
  }
}

// The words of each command of mtdb in a text: behind "    mtdb " to a comment or a pipe, and
// between `mtdb and `.
std::vector<Arguments> CommandsIn(const std::string& text) {
  std::vector<Arguments> commands;
  std::istringstream lines(text);
  for (std::string line, more; std::getline(lines, line);) {
    while (line.ends_with('\\') && std::getline(lines, more)) {
      line.pop_back();
      line += more;
    }
    size_t at = line.starts_with("    mtdb ") ? 9 : std::string::npos;
    const bool whole = at != std::string::npos;
    if (!whole) at = line.find("`mtdb ");
    while (at != std::string::npos) {
      if (!whole) at += 6;
      const size_t end = line.find_first_of(whole ? "#|;&>" : "`", at);
      Arguments& words = commands.emplace_back();
      std::istringstream in(line.substr(at, end - at));
      for (std::string word; in >> word;) words.push_back(word);
      at = whole || end == std::string::npos ? std::string::npos : line.find("`mtdb ", end + 1);
    }
  }
  return commands;
}

// What is wrong with a command's verb and options; empty when nothing is.
std::string WrongIn(const Arguments& words, std::map<std::string, std::string>* helps) {
  if (words.empty() || words[0] == "help" || words[0].starts_with("-") || words[0] == "VERB") {
    return "";
  }
  const std::string verb =
      words[0].substr(0, words[0].find_first_not_of("abcdefghijklmnopqrstuvwxyz"));
  if (!helps->contains(verb)) (*helps)[verb] = Run({"help", verb}).out;
  const std::string& help = (*helps)[verb];
  if (help.empty()) return "no verb " + words[0];
  for (const std::string& word : words) {
    if (!word.starts_with("--")) continue;
    const std::string name = word.substr(0, word.find_first_not_of("abcdefghijklmnopqrstuvwxyz-"));
    size_t at = help.find(name);
    while (at != std::string::npos && std::isalnum(help[at + name.size()]) != 0) {
      at = help.find(name, at + 1);
    }
    if (at == std::string::npos || name == "--") return words[0] + " has no option " + name;
  }
  return "";
}

}  // namespace

TEST_CASE("verbs and options that documents name exist", "[cli]") {
  std::map<std::string, std::string> helps;
  size_t count = 0;
  const std::filesystem::path root = MTDB_SOURCE_DIR;
  std::vector<std::filesystem::path> documents{root / "README.md"};
  for (const char* const folder : {"docs", "tools", "store", "query", "bench", "tests"}) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(root / folder)) {
      const std::string path = entry.path().string();
      if (path.ends_with(".md") && path.find("node_modules") == std::string::npos &&
          !path.ends_with("FORMAT.md")) {  // magic words begin so
        documents.push_back(path);
      }
    }
  }
  for (const std::filesystem::path& document : documents) {
    INFO(document.string());
    for (const Arguments& words : CommandsIn(ReadText(document.string()))) {
      ++count;
      CHECK(WrongIn(words, &helps) == "");
    }
  }
  CHECK(count > 100);
  const std::vector<Arguments> found =
      CommandsIn("    mtdb paint a --x  # no\nas `mtdb info --box`");
  REQUIRE(found == std::vector<Arguments>{{"paint", "a", "--x"}, {"info", "--box"}});
  CHECK(WrongIn(found[0], &helps) == "no verb paint");
  CHECK(WrongIn(found[1], &helps) == "info has no option --box");
}

TEST_CASE("the commands of the guide run as they stand", "[cli]") {
  const Folder folder;
  const std::vector<std::string> commands = CommandsOf("docs/guide.md");
  CHECK(commands.size() >= 15);
  MakePairs(folder);
  for (const std::string& command : commands) RunAsPrinted(folder, command);
}

TEST_CASE("the commands of README.md and docs/query.md run as printed", "[cli]") {
  const Folder folder;
  MakeScan(folder);
  // What the quickstart leaves, but smaller.
  std::filesystem::create_directories(folder.File("out/quickstart"));
  std::filesystem::copy(folder.File("scan.ply"), folder.File("out/quickstart/sculpture.ply"));
  RunOk({"ingest", folder.File("scan.ply"), folder.File("served.mtdb"), "--name", "scan"});
  const ServerProcess server(folder.File("served.mtdb"));
  WriteText(folder.File("flight.jsonl"), "{\"max_triangles\": 700}\n");
  int count = 0;
  for (const char* const document : {"README.md", "docs/query.md"}) {
    for (std::string command : CommandsOf(document)) {
      Replace(&command, "http://localhost:8080", server.url());
      RunAsPrinted(folder, command);
      ++count;
    }
  }
  CHECK(count >= 14);
}

TEST_CASE("the commands of docs/protocol.md and docs/packed.md run as printed", "[cli]") {
  const Folder folder;
  MakeScan(folder);
  const std::string store = folder.File("scans.mtdb");
  RunOk({"ingest", folder.File("scan.ply"), store, "--name", "statue"});
  const ServerProcess server(store);
  WriteText(folder.File("flight.jsonl"), "{\"max_triangles\": 700}\n");
  int count = 0;
  for (const char* const document : {"docs/protocol.md", "docs/packed.md"}) {
    for (std::string command : CommandsOf(document)) {
      Replace(&command, "http://127.0.0.1:8080", server.url());
      Replace(&command, "curl ", "curl --fail -sS ");
      // A packed file on a web server or in a bucket is the one on the disk here.
      Replace(&command, "https://example.org/", "");
      Replace(&command, "s3://bucket/", "");
      RunAsPrinted(folder, command);
      ++count;
    }
  }
  CHECK(count >= 12);
}

}  // namespace mtdb::test
