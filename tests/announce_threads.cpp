// Loaded ahead of a program's libraries: says on standard error each thread that the program starts.
#include <dlfcn.h>
#include <pthread.h>
#include <unistd.h>

extern "C" int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*start)(void*),
                              void* argument) noexcept {
  static const auto create = reinterpret_cast<decltype(&pthread_create)>(dlsym(RTLD_NEXT, "pthread_create"));
  constexpr char text[] = "starts a thread\n";
  if (write(STDERR_FILENO, text, sizeof text - 1) < 0) return -1;
  return create(thread, attributes, start, argument);
}
