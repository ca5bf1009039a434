// SPDX-License-Identifier: Apache-2.0
// HttpClient: one connection to an HTTP/1.1 server, for the client library (tools/client/client.h).
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>

#include "store/base/status.h"

namespace mtdb {

struct HttpUrl {
  std::string host;  // a name or an address; IPv6 without brackets
  std::string port;
  std::string path;  // with the leading slash; "/" when the text has none
  // "http://host:port"
  std::string origin() const;
};
// "http://HOST[:PORT][/PATH]". kInvalidArgument.
Result<HttpUrl> ParseHttpUrl(const std::string& text);
// Bytes other than letters, digits and -._~ as %XX.
std::string PercentEncode(const std::string& text);

struct HttpResponse {
  unsigned status = 0;
  std::map<std::string, std::string> headers;  // names in lower case
  // The body has no length and ends with the connection: whether it is whole cannot be known.
  bool until_close = false;
  // Empty when there is no such header.
  std::string header(const std::string& name) const;
};

// Single thread.
class HttpClient {
 public:
  // Connects. `idle_seconds` is the longest wait for the server to connect, to take a request, to
  // answer it with a whole head, and for each KiB of the body.
  // kIoError with a message that names the server.
  static Result<std::unique_ptr<HttpClient>> Connect(const HttpUrl& url, double idle_seconds);
  ~HttpClient();

  // Sends a request and hands the answer's body to `receive`, piece by piece (at most 64 KiB),
  // whatever its status; its first error ends the exchange and is returned. An answer that breaks
  // off is kIoError. An empty `body` is not sent.
  using Receiver = std::function<Status(const HttpResponse& response, std::string_view piece)>;
  Result<HttpResponse> Send(const std::string& method, const std::string& target,
                            const std::string& body, const Receiver& receive);

 private:
  struct Connection;
  explicit HttpClient(std::unique_ptr<Connection> connection);
  std::unique_ptr<Connection> connection_;
};

}  // namespace mtdb
