/* Binds hypot to the version that every glibc has: a build on glibc 2.35 or later would ask for that release. */
#if defined(__x86_64__) && defined(__linux__)
#include <math.h>
#if defined(__GLIBC__)
__asm__(".symver hypot,hypot@GLIBC_2.2.5");
#endif
#endif
