// SPDX-License-Identifier: Apache-2.0
#include "tests/tools/http_testing.h"

namespace mtdb::test {

HttpAnswer AskServer(int port, const std::string& method, const std::string& target,
                     const std::string& body) {
  RawConnection connection(port);
  if (!connection.connected()) return {};
  connection.Send(RequestText(method, target, body));
  return connection.ReceiveAnswer(method == "HEAD");
}

std::string OutsidePolygons(int count) {
  constexpr int kCorners = 12;
  std::string prisms;
  for (int i = 0; i < count; ++i) {
    std::string corners;
    for (int k = 0; k < kCorners; ++k) {
      const double angle = 6.283 * k / kCorners;
      const auto number = [](double value) {
        return std::to_string(std::lround(1e4 * value)) + "e-4";
      };
      corners += (k == 0 ? "[" : ",[") + number((i % 80 - 40) / 40.0 + 1e-3 * std::cos(angle)) +
                 "," + number((i / 80 - 25) / 25.0 + 1e-3 * std::sin(angle)) + "]";
    }
    prisms += (i == 0 ? "" : ",") + (R"({"prism":{"polygon":[)" + corners) + "]}}";
  }
  return R"({"region":{"outside":{"union":[)" + prisms + R"(]}},"clip":true})";
}

std::string SlowQuery() { return OutsidePolygons(1000); }

std::string EndlessQuery() { return OutsidePolygons(4000); }

ServerProcess::ServerProcess(const std::string& store, const Arguments& options, int port) {
  const std::string listen = "127.0.0.1:" + std::to_string(port);
  Arguments arguments{"serve", store, "--listen", listen, "--tmp", TmpFolder()};
  arguments.insert(arguments.end(), options.begin(), options.end());
  process_ = Start(arguments, folder_.File("out"), folder_.File("err"));
  for (int i = 0; i < 2000 && port_ == 0; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    const std::string line = ReadText(folder_.File("out"));
    if (!line.ends_with('\n')) continue;
    url_ = line.substr(0, line.size() - 1);
    port_ = std::stoi(url_.substr(url_.rfind(':') + 1));
  }
  INFO(errors());
  REQUIRE(port_ > 0);
}

ServerProcess::~ServerProcess() {
  if (process_ == 0) return;
  ::kill(process_, SIGKILL);
  ::waitpid(process_, nullptr, 0);
}

size_t ServerProcess::temporary_files() const {
  size_t files = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(TmpFolder())) {
    files += entry.is_regular_file() ? 1 : 0;
  }
  return files;
}

std::string ServerProcess::TmpFolder() const {
  std::filesystem::create_directory(folder_.File("tmp"));
  return folder_.File("tmp");
}

double ServerProcess::Metric(const std::string& name) const {
  const std::string text = "\n" + Get("/metrics").body;
  const size_t at = text.find("\n" + name + " ");
  return at == std::string::npos ? -1 : std::stod(text.substr(at + name.size() + 2));
}

uint64_t ServerProcess::resident_bytes() const {
  std::istringstream statm(ReadText("/proc/" + std::to_string(process_) + "/statm"));
  uint64_t total = 0, resident = 0;
  statm >> total >> resident;
  return resident * static_cast<uint64_t>(::sysconf(_SC_PAGESIZE));
}

}  // namespace mtdb::test
