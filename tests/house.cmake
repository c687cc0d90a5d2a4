# The house: arrows between folders, headers that stand alone, what must not compile.
add_test(NAME include_arrows
  COMMAND ${CMAKE_COMMAND} -DINCLUDE=${PROJECT_SOURCE_DIR}/include -P ${CMAKE_CURRENT_SOURCE_DIR}/include_arrows.cmake)

file(GLOB_RECURSE headers CONFIGURE_DEPENDS RELATIVE ${PROJECT_SOURCE_DIR}/include ${PROJECT_SOURCE_DIR}/include/rbres/*.hpp)
if(TARGET rbres::io)
  set(library rbres::io)
else()
  set(library rbres::rbres)
  list(FILTER headers EXCLUDE REGEX "rbres/io")
endif()
set(alone "")
foreach(header IN LISTS headers)
  string(MAKE_C_IDENTIFIER ${header} name)
  set(source ${CMAKE_CURRENT_BINARY_DIR}/self_contained/${name}.cpp)
  file(CONFIGURE OUTPUT ${source} CONTENT "#include <${header}>\n" @ONLY)
  list(APPEND alone ${source})
endforeach()
add_library(rbres_self_contained OBJECT EXCLUDE_FROM_ALL ${alone})
target_link_libraries(rbres_self_contained PRIVATE ${library} rbres_development)

get_target_property(eigen_folders Eigen3::Eigen INTERFACE_INCLUDE_DIRECTORIES)
set(compile_pair ${CMAKE_CXX_COMPILER} -std=c++20 -fsyntax-only -I${PROJECT_SOURCE_DIR}/include -I${eigen_folders}
  ${CMAKE_CURRENT_SOURCE_DIR}/compile_fail/missing_pair.cpp)
add_test(NAME compile_known_pair COMMAND ${compile_pair} -DRBRES_KNOWN_PAIR)
add_test(NAME compile_missing_pair COMMAND ${compile_pair})
set_tests_properties(compile_missing_pair PROPERTIES PASS_REGULAR_EXPRESSION "no matching function for call to [^\n]*detect")

# The proof that comes with the library, as a test.
if(TARGET rbres_validate)
  add_test(NAME validate COMMAND rbres_validate)
endif()
