// SPDX-License-Identifier: Apache-2.0
// A WebSocket client that sends what it is told, byte by byte.
#pragma once

#include <optional>

#include "tests/support/raw_connection.h"

namespace mtdb::test {

constexpr int kText = 1, kBinary = 2, kCloseFrame = 8, kPing = 9, kPong = 10;

struct Frame {
  int opcode = 0;
  std::string payload;
  // Of a close frame.
  int close_code() const {
    return payload.size() < 2 ? 0
                              : 256 * static_cast<unsigned char>(payload[0]) +
                                    static_cast<unsigned char>(payload[1]);
  }
};

// `first` is the first byte, opcode and flags.
inline std::string FrameText(int first, const std::string& payload, bool masked = true) {
  std::string frame(1, static_cast<char>(first));
  const size_t size = payload.size();
  const int mask_bit = masked ? 0x80 : 0;
  if (size < 126) {
    frame += static_cast<char>(mask_bit | static_cast<int>(size));
  } else {
    const int bytes = size < 65536 ? 2 : 8;
    frame += static_cast<char>(mask_bit | (bytes == 2 ? 126 : 127));
    for (int i = bytes; i-- > 0;) frame += static_cast<char>(size >> 8 * i);
  }
  if (!masked) return frame + payload;
  const std::string mask = "\x11\x52\x93\xd4";
  frame += mask;
  for (size_t i = 0; i < size; ++i) frame += static_cast<char>(payload[i] ^ mask[i % 4]);
  return frame;
}
inline std::string TextFrame(const std::string& text) { return FrameText(0x80 | kText, text); }

inline std::string UpgradeRequest(const std::string& target, const std::string& more = "") {
  return RequestText("GET", target, "",
                     "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                     "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n" +
                         more);
}

inline std::string QueryMessage(uint64_t id, const std::string& query) {
  return R"({"id": )" + std::to_string(id) + R"(, "query": )" + query + "}";
}

class RawSession : public RawConnection {
 public:
  // `receive_bytes` and `from` as RawConnection's.
  RawSession(int port, const std::string& target, int receive_bytes = 0, int from = 1)
      : RawConnection(port, receive_bytes, from) {
    Send(UpgradeRequest(target));
    status_ = ReceiveAnswer(true).status;
  }
  int status() const { return status_; }

  // The next message, or what stands between the parts of one: a ping, a pong, a close. Empty when
  // the server closes the connection.
  std::optional<Frame> ReceiveFrame() {
    while (true) {
      const std::string head = Take(2);
      if (head.size() < 2) return std::nullopt;
      size_t size = static_cast<unsigned char>(head[1]) & 0x7f;
      if (size >= 126) {
        const std::string length = Take(size == 126 ? 2 : 8);
        size = 0;
        for (const char c : length) size = 256 * size + static_cast<unsigned char>(c);
      }
      const int opcode = static_cast<unsigned char>(head[0]) & 15;
      if (opcode >= kCloseFrame) return Frame{opcode, Take(size)};
      if (opcode != 0) message_ = {opcode, ""};
      message_.payload += Take(size);
      if ((static_cast<unsigned char>(head[0]) & 0x80) != 0) return std::exchange(message_, {});
    }
  }
  // The next text message, as JSON; null when there is none.
  Json ReceiveText() {
    while (const std::optional<Frame> frame = ReceiveFrame()) {
      if (frame->opcode == kText) return ParseJson(frame->payload);
      if (frame->opcode == kCloseFrame) break;
    }
    return nullptr;
  }
  // The code that the server closes with; 0: without one.
  int ReceiveClose() {
    while (const std::optional<Frame> frame = ReceiveFrame()) {
      if (frame->opcode == kCloseFrame) return frame->close_code();
    }
    return 0;
  }

 private:
  int status_ = 0;
  Frame message_;  // as far as it has come
};

}  // namespace mtdb::test
