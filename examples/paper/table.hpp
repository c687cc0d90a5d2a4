// Tables as text for a terminal and as Markdown.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

namespace paper {

/// A number in three digits; "-" where there is none.
inline std::string digits(double x) {
  if (!std::isfinite(x)) return "-";
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", x);
  return text;
}

struct Table {
  std::string title;
  std::vector<std::string> head;               ///< the first column's name may be empty
  std::vector<std::vector<std::string>> rows;  ///< as long as the head
  std::string note;                            ///< what a reader must know, or empty

  void print() const {
    std::vector<std::size_t> widths(head.size());
    for (std::size_t i = 0; i < head.size(); ++i) {
      widths[i] = width(head[i]);
      for (const auto& row : rows) widths[i] = std::max(widths[i], width(row[i]));
    }
    std::printf("\n%s\n", title.c_str());
    const auto line = [&](const std::vector<std::string>& cells) {
      for (std::size_t i = 0; i < cells.size(); ++i) {
        const std::string fill(widths[i] - width(cells[i]), ' ');
        std::printf("  %s", (i == 0 ? cells[i] + fill : fill + cells[i]).c_str());
      }
      std::printf("\n");
    };
    line(head);
    for (const auto& row : rows) line(row);
    if (!note.empty()) std::printf("  %s\n", note.c_str());
  }

  std::string markdown() const {
    std::string text = "### " + title + "\n\n";
    const auto line = [&](const std::vector<std::string>& cells) {
      text += "|";
      for (const std::string& cell : cells) text += " " + cell + " |";
      text += "\n";
    };
    line(head);
    line(std::vector<std::string>(head.size(), "---"));
    for (const auto& row : rows) line(row);
    return text + (note.empty() ? "" : "\n" + note + "\n") + "\n";
  }

 private:
  /// Characters, not bytes: continuation bytes of UTF-8 take no place.
  static std::size_t width(const std::string& text) {
    return static_cast<std::size_t>(
        std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80; }));
  }
};

}  // namespace paper
