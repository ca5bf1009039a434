// `mtdb serve` as a process, and raw connections to it.
#pragma once

#include <arpa/inet.h>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <map>
#include <memory>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <thread>

#include "tests/tools/cli_testing.h"

namespace mtdb::test {

constexpr int kSocketTimeoutMs = 60'000;

struct HttpAnswer {
  int status = 0;  // 0: the server closed without a whole answer
  std::map<std::string, std::string> headers;
  std::string body;

  std::string header(const std::string& name) const {
    const auto at = headers.find(name);
    return at == headers.end() ? "" : at->second;
  }
  Json json() const { return Json::parse(body); }
  std::string error() const { return json().at("error"); }
  std::string code() const { return json().at("code"); }
};

// A TCP connection that sends what it is told.
class RawConnection {
 public:
  // With `receive_bytes`, so small a receive buffer that the server soon has to wait. From
  // 127.0.0.`from`: each is a client of its own to the server.
  explicit RawConnection(int port, int receive_bytes = 0, int from = 1)
      : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    if (receive_bytes > 0) {
      ::setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &receive_bytes, sizeof(receive_bytes));
    }
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    sockaddr_in own{};
    own.sin_family = AF_INET;
    own.sin_addr.s_addr = htonl(INADDR_LOOPBACK - 1 + static_cast<uint32_t>(from));
    if (from != 1) ::bind(socket_, reinterpret_cast<sockaddr*>(&own), sizeof(own));
    connected_ = ::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof(address)) == 0;
  }
  ~RawConnection() { Close(); }
  RawConnection(const RawConnection&) = delete;
  RawConnection& operator=(const RawConnection&) = delete;

  bool connected() const { return connected_; }
  void Close() {
    if (socket_ >= 0) ::close(std::exchange(socket_, -1));
  }
  void CloseSending() { ::shutdown(socket_, SHUT_WR); }
  // Sends what goes without waiting; false when that is not all.
  bool SendNow(std::string_view bytes) {
    return ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT) ==
           static_cast<ssize_t>(bytes.size());
  }

  bool Send(std::string_view bytes) {
    while (!bytes.empty()) {
      const ssize_t n = ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
      if (n <= 0) return false;
      bytes.remove_prefix(static_cast<size_t>(n));
    }
    return true;
  }

  // More bytes of what was received; false at the end.
  bool Receive() {
    pollfd entry{socket_, POLLIN, 0};
    if (::poll(&entry, 1, kSocketTimeoutMs) != 1) return false;
    char block[1 << 16];
    const ssize_t n = ::recv(socket_, block, sizeof(block), 0);
    if (n <= 0) return false;
    received_.append(block, static_cast<size_t>(n));
    return true;
  }
  // The next `size` bytes; fewer when the server closes.
  std::string Take(size_t size) {
    while (received_.size() < size && Receive()) {
    }
    const std::string bytes = received_.substr(0, size);
    received_.erase(0, size);
    return bytes;
  }
  // All that comes until the server closes.
  std::string ReceiveAll() {
    while (Receive()) {
    }
    return std::move(received_);
  }

  HttpAnswer ReceiveAnswer(bool head = false) {
    HttpAnswer answer;
    size_t end = 0;
    while ((end = received_.find("\r\n\r\n")) == std::string::npos) {
      if (!Receive()) return {};
    }
    std::istringstream lines(received_.substr(0, end));
    received_.erase(0, end + 4);
    std::string line;
    std::getline(lines, line);
    const int status = line.starts_with("HTTP/1.1 ") ? std::atoi(line.c_str() + 9) : 0;
    while (std::getline(lines, line)) {
      if (line.ends_with('\r')) line.pop_back();
      const size_t colon = line.find(": ");
      if (colon != std::string::npos)
        answer.headers[line.substr(0, colon)] = line.substr(colon + 2);
    }
    const size_t size = head ? 0 : std::stoull("0" + answer.header("Content-Length"));
    while (received_.size() < size) {
      if (!Receive()) return {};
    }
    answer.body = received_.substr(0, size);
    received_.erase(0, size);
    answer.status = status;
    return answer;
  }

 private:
  int socket_;
  bool connected_ = false;
  std::string received_;
};

inline std::string RequestText(const std::string& method, const std::string& target,
                               const std::string& body = "", const std::string& more = "") {
  std::string text = method + " " + target + " HTTP/1.1\r\nHost: localhost\r\n" + more;
  if (!body.empty()) text += "Content-Length: " + std::to_string(body.size()) + "\r\n";
  return text + "\r\n" + body;
}

// A server of one store; stopped by the destructor.
class ServerProcess {
 public:
  // On any free port, or on `port`.
  explicit ServerProcess(const std::string& store, const Arguments& options = {}, int port = 0) {
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
  ~ServerProcess() {
    if (process_ == 0) return;
    ::kill(process_, SIGKILL);
    ::waitpid(process_, nullptr, 0);
  }

  const std::string& url() const { return url_; }
  int port() const { return port_; }
  std::string errors() const { return ReadText(folder_.File("err")); }
  // Temporary files that are there now.
  size_t temporary_files() const {
    size_t files = 0;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(TmpFolder())) {
      files += entry.is_regular_file() ? 1 : 0;
    }
    return files;
  }
  std::string TmpFolder() const {
    std::filesystem::create_directory(folder_.File("tmp"));
    return folder_.File("tmp");
  }

  void Signal(int signal) { ::kill(process_, signal); }
  // Waits for its end.
  Outcome Finish() { return test::Finish(std::exchange(process_, 0)); }
  Outcome Stop() {
    Signal(SIGTERM);
    return Finish();
  }

  HttpAnswer Ask(const std::string& method, const std::string& target,
                 const std::string& body = "") const {
    RawConnection connection(port_);
    if (!connection.connected()) return {};
    connection.Send(RequestText(method, target, body));
    return connection.ReceiveAnswer(method == "HEAD");
  }
  HttpAnswer Get(const std::string& target) const { return Ask("GET", target); }

  // A value of /metrics; -1 when there is none of that name.
  double Metric(const std::string& name) const {
    const std::string text = "\n" + Get("/metrics").body;
    const size_t at = text.find("\n" + name + " ");
    return at == std::string::npos ? -1 : std::stod(text.substr(at + name.size() + 2));
  }
  // Waits until a value of /metrics is at least `least`, or exactly `value`.
  bool Reaches(const std::string& name, double least) const {
    return Await([&] { return Metric(name) >= least; });
  }
  bool Becomes(const std::string& name, double value) const {
    return Await([&] { return Metric(name) == value; });
  }
  template <typename Condition>
  static bool Await(Condition&& condition) {
    for (int i = 0; i < 12000; ++i) {
      if (condition()) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return false;
  }
  pid_t process() const { return process_; }
  // What the server's process has in memory.
  uint64_t resident_bytes() const {
    std::istringstream statm(ReadText("/proc/" + std::to_string(process_) + "/statm"));
    uint64_t total = 0, resident = 0;
    statm >> total >> resident;
    return resident * static_cast<uint64_t>(::sysconf(_SC_PAGESIZE));
  }

 private:
  Folder folder_;
  pid_t process_ = 0;
  std::string url_;
  int port_ = 0;
};

// A query that takes some seconds: the polygon has to be looked at for every triangle.
inline std::string SlowQuery() {
  Json polygon = Json::array();
  constexpr int kCorners = 20000;
  for (int i = 0; i < kCorners; ++i) {
    const double angle = 6.283 * i / kCorners;
    const double radius = i % 2 == 0 ? 100 : 0.001;
    polygon.push_back({std::round(1e4 * radius * std::cos(angle)) / 1e4,
                       std::round(1e4 * radius * std::sin(angle)) / 1e4});
  }
  return Json{{"region", {{"prism", {{"polygon", polygon}}}}}}.dump();
}

// A query that takes ten seconds or more: each triangle's distance from many places.
inline std::string EndlessQuery() {
  std::string spheres;
  for (int i = 0; i < 18000; ++i) {
    const std::string x = std::to_string(i % 180 - 90), y = std::to_string(i / 180 - 50);
    spheres += (i == 0 ? "" : ",") + (R"({"sphere":{"centre":[)" + x + "e-2," + y) +
               R"(e-2,0],"radius":1e-9}})";
  }
  return R"({"region":{"outside":{"union":[)" + spheres + R"(]}},"clip":true})";
}

}  // namespace mtdb::test
