/* Runs every test:  tests [filter [share shares]]   where the filter is part of "area/name"; of `shares` processes, each
   of which runs every so many tests, this is number `share`, from 0. */
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#define CONEMAP_IMPLEMENTATION
#include "conemap.h"
#include "test.h"

#define PRINTED_FAILURES 5
#define GUARD 64

static const char *running_name;
static int running_failures;
static char area_notes[512];

int test_fail(const char *file, int line, const char *format, ...)
{
    va_list arguments;
    ++running_failures;
    if (running_failures > PRINTED_FAILURES) return 0;
    printf("%s:%d: %s: ", file, line, running_name);
    va_start(arguments, format);
    vprintf(format, arguments);
    va_end(arguments);
    printf("\n");
    fflush(stdout);
    return 0;
}

void test_note(const char *format, ...)
{
    size_t used = strlen(area_notes);
    va_list arguments;
    if (used + 3 >= sizeof area_notes) return;
    memcpy(area_notes + used, "; ", 3);
    va_start(arguments, format);
    vsnprintf(area_notes + used + 2, sizeof area_notes - used - 2, format, arguments);
    va_end(arguments);
}

void *test_alloc(size_t size)
{
    unsigned char *whole = (unsigned char *)malloc(size + 2 * GUARD);
    if (!whole) {
        printf("out of memory\n");
        exit(2);
    }
    memset(whole, 0xa5, size + 2 * GUARD);
    memcpy(whole, &size, sizeof size);
    return whole + GUARD;
}

void test_release(void *memory)
{
    unsigned char *whole;
    size_t size, k;
    if (!memory) return;
    whole = (unsigned char *)memory - GUARD;
    memcpy(&size, whole, sizeof size);
    for (k = sizeof size; k < GUARD; ++k) {
        if (whole[k] != 0xa5) {
            CHECK(0, "written %d bytes before a buffer", (int)(GUARD - k));
            break;
        }
    }
    for (k = 0; k < GUARD; ++k) {
        if (whole[GUARD + size + k] != 0xa5) {
            CHECK(0, "written %d bytes past a buffer of %d", (int)k, (int)size);
            break;
        }
    }
    free(whole);
}

int main(int argument_count, char **arguments)
{
    static const struct {
        const char *name;
        const struct test_case *cases;
    } areas[] = {
#ifdef TEST_WRITE /* writes the emitted C that the tests compile */
        {"emit", emit_tests},
        {"emit_frusta", emit_frusta_tests},
        {"shading", shading_tests},
#elif !defined TEST_FEW
        {"kernels", kernels_tests},
#endif
#if !defined TEST_KERNELS_ONLY && !defined TEST_WRITE /* the first: what other instruction sets are tested with */
        {"truth", truth_tests},
        {"safe", safe_tests},
        {"updates", updates_tests},
        {"stability", stability_tests},
        {"formats", formats_tests},
        {"samples", samples_tests},
        {"tracers", tracers_tests},
        {"builds", builds_tests},
        {"inputs", inputs_tests},
#ifndef TEST_FEW /* what goes through emulators and valgrind */
        {"oracle", oracle_tests},
        {"verify", verify_tests},
        {"header", header_tests},
        {"directional", directional_tests},
        {"emit", emit_tests},
        {"frusta", frusta_tests},
        {"emit_frusta", emit_frusta_tests},
        {"effects", effects_tests},
        {"frusta_effects", frusta_effects_tests},
        {"shading", shading_tests},
        {"plan", plan_tests},
        {"packets", packets_tests},
#endif
#endif
    };
    const char *filter = argument_count > 1 ? arguments[1] : NULL;
    int share = argument_count > 3 ? atoi(arguments[2]) : 0, shares = argument_count > 3 ? atoi(arguments[3]) : 1;
    int passed = 0, failed = 0, number = 0, area;

    for (area = 0; area < (int)(sizeof areas / sizeof areas[0]); ++area) {
        int area_passed = 0, area_failed = 0, k;
        area_notes[0] = 0;
        for (k = 0; areas[area].cases[k].name; ++k) {
            char name[128];
            snprintf(name, sizeof name, "%s/%s", areas[area].name, areas[area].cases[k].name);
            if (filter && !strstr(name, filter)) continue;
            if (number++ % shares != share) continue;
            running_name = name;
            running_failures = 0;
            areas[area].cases[k].run();
            if (running_failures > PRINTED_FAILURES) {
                printf("%s: %d failures in all\n", name, running_failures);
            }
            if (running_failures) ++area_failed;
            else ++area_passed;
        }
        if (area_passed + area_failed) {
            printf("%-8s %d passed, %d failed%s\n", areas[area].name, area_passed, area_failed, area_notes);
            fflush(stdout);
        }
        passed += area_passed;
        failed += area_failed;
    }
    printf("%d passed, %d failed\n", passed, failed);
    return failed ? 1 : 0;
}
