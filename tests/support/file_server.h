// SPDX-License-Identifier: Apache-2.0
// A web server of one file, for tests: it answers ranges, or whatever a test makes of the answer.
#pragma once

#include <algorithm>
#include <arpa/inet.h>
#include <atomic>
#include <cctype>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstring>
#include <functional>
#include <list>
#include <map>
#include <mutex>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sstream>
#include <string>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>
#include <utility>

namespace mtdb::testing {

struct FileRequest {
  int number = 0;  // from 0, over all connections
  std::string target;
  std::map<std::string, std::string> headers;  // names in small letters
  bool ranged = false;
  uint64_t first = 0, last = 0;  // of the range, within the file
};

struct FileReply {
  std::string status = "206 Partial Content";
  std::map<std::string, std::string> headers;  // without Content-Length
  std::string body;
  // How the body's length is told; empty: rightly.
  std::string told_length;
  size_t sent = SIZE_MAX;  // bytes of the body; then the connection ends
  int pause_ms = 0;        // before the answer
  bool hangs = false;      // no answer
  bool resets = false;     // likewise
  std::string raw;         // if not empty: this instead of everything
  std::string again;       // behind it, again and again
  int again_ms = 20;       // so often
};

class FileServer {
 public:
  // Changes the right answer.
  using Behaviour = std::function<void(const FileRequest&, FileReply*)>;

  explicit FileServer(std::string file, Behaviour behaviour = {})
      : file_(std::move(file)), behaviour_(std::move(behaviour)) {
    std::signal(SIGPIPE, SIG_IGN);
    listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(address);
    ::bind(listener_, reinterpret_cast<sockaddr*>(&address), size);
    ::listen(listener_, 64);
    ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
    acceptor_ = std::thread([this] { Accept(); });
  }
  ~FileServer() {
    stopping_ = true;
    ::shutdown(listener_, SHUT_RDWR);
    acceptor_.join();
    ::close(listener_);
    for (std::thread& t : connections_) t.join();
  }
  FileServer(const FileServer&) = delete;
  FileServer& operator=(const FileServer&) = delete;

  int port() const { return port_; }
  std::string url(const std::string& target = "/file.mtdbp") const {
    return "http://127.0.0.1:" + std::to_string(port_) + target;
  }
  int requests() const { return requests_; }
  uint64_t bytes_sent() const { return bytes_sent_; }

 private:
  void Accept() {
    while (!stopping_) {
      const int socket = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
      if (socket < 0) continue;
      const int on = 1;
      ::setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof(on));
      connections_.emplace_back([this, socket] {
        while (Answer(socket)) {
        }
        ::close(socket);
      });
    }
  }

  // False when the client is gone or the server stops.
  bool WaitFor(int socket) const {
    while (!stopping_) {
      pollfd p{socket, POLLIN, 0};
      if (::poll(&p, 1, 20) > 0) return true;
    }
    return false;
  }

  bool ReadHead(int socket, std::string* head) const {
    while (head->find("\r\n\r\n") == std::string::npos) {
      char block[4096];
      if (!WaitFor(socket)) return false;
      const ssize_t n = ::recv(socket, block, sizeof(block), 0);
      if (n <= 0) return false;
      head->append(block, static_cast<size_t>(n));
    }
    return true;
  }

  bool Send(int socket, const std::string& bytes) {
    for (size_t at = 0; at < bytes.size();) {
      const ssize_t n = ::send(socket, bytes.data() + at, bytes.size() - at, MSG_NOSIGNAL);
      if (n <= 0 || stopping_) return false;
      at += static_cast<size_t>(n);
      bytes_sent_ += static_cast<uint64_t>(n);
    }
    return true;
  }

  FileRequest Parse(const std::string& head) {
    FileRequest request;
    request.number = requests_++;
    std::istringstream lines(head);
    std::string method, line;
    lines >> method >> request.target;
    std::getline(lines, line);
    while (std::getline(lines, line) && line != "\r") {
      const size_t colon = line.find(':');
      if (colon == std::string::npos) continue;
      std::string name = line.substr(0, colon);
      std::ranges::transform(name, name.begin(), [](unsigned char c) { return std::tolower(c); });
      request.headers[name] = line.substr(colon + 2, line.size() - colon - 3);
    }
    const std::string range = request.headers["range"];
    unsigned long long first = 0, last = 0;
    request.ranged =
        std::sscanf(range.c_str(), "bytes=%llu-%llu", &first, &last) == 2 && first < file_.size();
    request.first = first;
    request.last = std::min<uint64_t>(last, file_.size() - 1);
    return request;
  }

  bool Answer(int socket) {
    std::string head;
    if (!ReadHead(socket, &head)) return false;
    const FileRequest request = Parse(head);
    FileReply reply;
    reply.headers["ETag"] = "\"one\"";
    const auto if_range = request.headers.find("if-range");
    const bool same = if_range == request.headers.end() || if_range->second == "\"one\"";
    if (request.ranged && same) {
      reply.body = file_.substr(request.first, request.last - request.first + 1);
      reply.headers["Content-Range"] = "bytes " + std::to_string(request.first) + "-" +
                                       std::to_string(request.last) + "/" +
                                       std::to_string(file_.size());
    } else {
      reply.status = "200 OK";
      reply.body = file_;
    }
    if (behaviour_) {
      const std::lock_guard lock(mutex_);
      behaviour_(request, &reply);
    }
    return Send(socket, reply);
  }

  bool Send(int socket, const FileReply& reply) {
    if (reply.pause_ms > 0) std::this_thread::sleep_for(std::chrono::milliseconds(reply.pause_ms));
    if (reply.resets) {
      const linger now{1, 0};
      ::setsockopt(socket, SOL_SOCKET, SO_LINGER, &now, sizeof(now));
      return false;
    }
    if (reply.hangs) {
      while (!stopping_ && !WaitFor(socket)) {  // until the client has had enough
      }
      return false;
    }
    if (!reply.raw.empty()) {
      bool sent = Send(socket, reply.raw);
      while (sent && !reply.again.empty()) {
        std::this_thread::sleep_for(std::chrono::milliseconds(reply.again_ms));
        sent = Send(socket, reply.again);
      }
      return false;
    }
    std::string text = "HTTP/1.1 " + reply.status + "\r\n";
    for (const auto& [name, value] : reply.headers) text += name + ": " + value + "\r\n";
    text += "Content-Length: " +
            (reply.told_length.empty() ? std::to_string(reply.body.size()) : reply.told_length) +
            "\r\n\r\n" + reply.body.substr(0, reply.sent);
    return Send(socket, text) && reply.sent >= reply.body.size() && reply.told_length.empty();
  }

  const std::string file_;
  const Behaviour behaviour_;
  int listener_ = -1;
  int port_ = 0;
  std::atomic<bool> stopping_{false};
  std::atomic<int> requests_{0};
  std::atomic<uint64_t> bytes_sent_{0};
  std::mutex mutex_;  // behaviours are called one at a time
  std::list<std::thread> connections_;
  std::thread acceptor_;
};

}  // namespace mtdb::testing
