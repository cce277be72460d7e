/* The harness: named tests in tables, a check macro, counts. */
#ifndef TEST_H
#define TEST_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

struct test_case {
    const char *name;
    void (*run)(void);
};

/* Every area's table ends with {NULL, NULL}. */
extern const struct test_case truth_tests[];
extern const struct test_case oracle_tests[];
extern const struct test_case formats_tests[];
extern const struct test_case samples_tests[];
extern const struct test_case safe_tests[];
extern const struct test_case updates_tests[];
extern const struct test_case verify_tests[];
extern const struct test_case stability_tests[];
extern const struct test_case tracers_tests[];
extern const struct test_case builds_tests[];
extern const struct test_case inputs_tests[];
extern const struct test_case header_tests[];
extern const struct test_case kernels_tests[];
extern const struct test_case directional_tests[];
extern const struct test_case emit_tests[];
extern const struct test_case frusta_tests[];
extern const struct test_case emit_frusta_tests[];
extern const struct test_case effects_tests[];
extern const struct test_case frusta_effects_tests[];
extern const struct test_case shading_tests[];
extern const struct test_case plan_tests[];
extern const struct test_case packets_tests[];

/* Notes a failure of the running test; the first few of each test are printed. Returns 0. */
#if defined(__GNUC__)
__attribute__((format(printf, 3, 4)))
#endif
int test_fail(const char *file, int line, const char *format, ...);

/* Adds a remark (a count worth knowing) to the line of the running area. */
#if defined(__GNUC__)
__attribute__((format(printf, 1, 2)))
#endif
void test_note(const char *format, ...);

/* CHECK(condition, "format", ...): goes on after a failure and is nonzero if the condition holds.
   REQUIRE(...): leaves the function (returning nothing) after a failure. */
#define CHECK(condition, ...) ((condition) ? 1 : test_fail(__FILE__, __LINE__, __VA_ARGS__))
#define REQUIRE(condition, ...)                                                                              \
    do {                                                                                                     \
        if (!CHECK(condition, __VA_ARGS__)) return;                                                          \
    } while (0)

/* Memory or the end of the run: a test without memory proves nothing. Guarded on both sides. */
void *test_alloc(size_t size);
void test_release(void *memory); /* fails the running test if a guard byte was changed */

#ifdef __cplusplus
}
#endif

#endif
