// Included before every C++ file on Windows: libstdc++ makes UTF-8 of a path, but takes text for a path in the encoding
// of the C locale, which has no umlauts. With this, text is UTF-8 in both directions.
#ifdef __cplusplus
#include <filesystem>
template <>
inline auto std::filesystem::path::_S_convert<char>(const char* first, const char* last) {
  return __detail::__wstr_from_utf8(std::string_view(first, static_cast<std::size_t>(last - first)));
}
#endif
