// SPDX-License-Identifier: Apache-2.0
#include "tests/support/raw_connection.h"

namespace mtdb::test {

std::string HttpAnswer::error() const { return json().at("error"); }
std::string HttpAnswer::code() const { return json().at("code"); }

std::string RequestText(const std::string& method, const std::string& target,
                        const std::string& body, const std::string& more) {
  std::string text = method + " " + target + " HTTP/1.1\r\nHost: localhost\r\n" + more;
  if (!body.empty()) text += "Content-Length: " + std::to_string(body.size()) + "\r\n";
  return text + "\r\n" + body;
}

RawConnection::RawConnection(int port, int receive_bytes, int from)
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

bool RawConnection::Send(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t n = ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (n <= 0) return false;
    bytes.remove_prefix(static_cast<size_t>(n));
  }
  return true;
}

bool RawConnection::Receive() {
  pollfd entry{socket_, POLLIN, 0};
  if (::poll(&entry, 1, kSocketTimeoutMs) != 1) return false;
  char block[1 << 16];
  const ssize_t n = ::recv(socket_, block, sizeof(block), 0);
  if (n <= 0) return false;
  received_.append(block, static_cast<size_t>(n));
  return true;
}

std::string RawConnection::Take(size_t size) {
  while (received_.size() < size && Receive()) {
  }
  const std::string bytes = received_.substr(0, size);
  received_.erase(0, size);
  return bytes;
}

std::string RawConnection::ReceiveAll() {
  while (Receive()) {
  }
  return std::move(received_);
}

HttpAnswer RawConnection::ReceiveAnswer(bool head) {
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
    if (colon != std::string::npos) answer.headers[line.substr(0, colon)] = line.substr(colon + 2);
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

}  // namespace mtdb::test
