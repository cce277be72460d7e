#!/usr/bin/env bash
# The heavier checks. Each part prints `ok`, `FAILED` or `skipped` (with the missing tool); a failure anywhere makes the
# exit status 1. `check.sh WORD` runs the parts whose name holds WORD.
set -u
cd "$(dirname "$0")/.."
only=${1:-}
work=build/check
mkdir -p "$work" out
warn="-Wall -Wextra -Wpedantic -Wconversion -Wsign-conversion -Wshadow -Wundef -Werror"
whole="tests/*.c"
suite="-DTEST_NO_COPIES $(ls tests/*.c | grep -v /static_)" # without the private copies, which take long to compile
few="-DTEST_FEW tests/main.c tests/truth.c tests/safe.c tests/updates.c tests/stability.c tests/formats.c tests/samples.c
     tests/tracers.c tests/builds.c tests/inputs.c"
strict="-ffp-contract=off"
make -s build/written/done || exit 1 # emitted C that is among the tests
rm -f "$work/counts" "$work/ok" "$work/failed" "$work/skipped"

have() { command -v "$1" >/dev/null 2>&1; }

# part NAME COMMAND...: runs it in the background, as many at a time as there are processors, in a folder of its own ($dir);
# says how it went, with the end of its output when it failed.
jobs_at_once=$(nproc 2>/dev/null || echo 2)
part() {
    local name=$1
    shift
    case "$name" in *"$only"*) ;; *) return 0 ;; esac
    while [ "$(jobs -rp | wc -l)" -ge "$jobs_at_once" ]; do wait -n; done
    (
        start=$SECONDS
        dir=$work/$(printf %s "$name" | tr -c 'A-Za-z0-9.+-' _)
        mkdir -p "$dir"
        "$@" >"$dir/log" 2>&1
        status=$?
        if [ $status = 0 ]; then
            # Beside the time that passed, the processors' time, which says what a part costs.
            times >"$dir/times"
            cpu=$(awk 'END {split($0, t, /[ms ]+/); printf "%d", 60 * (t[1] + t[3]) + t[2] + t[4]}' "$dir/times")
            printf 'ok       %s (%d s, %s s of processors)\n' "$name" $((SECONDS - start)) "$cpu"
            echo >>"$work/ok"
        elif [ $status = 77 ]; then
            printf 'skipped  %s: %s\n' "$name" "$(tail -n 1 "$dir/log")"
            echo >>"$work/skipped"
        else
            printf 'FAILED   %s\n%s\n' "$name" "$(tail -n 25 "$dir/log" | sed 's/^/         | /')"
            echo >>"$work/failed"
        fi
    ) &
}

skip() {
    case "$1" in *"$only"*) ;; *) return 0 ;; esac
    echo >>"$work/skipped"
    printf 'skipped  %s: no %s\n' "$1" "$2"
}

# need NAME TOOL...: true if every tool is there; says what is missing otherwise.
need() {
    local name=$1 tool
    shift
    for tool in "$@"; do
        have "$tool" || { skip "$name" "$tool"; return 1; }
    done
}

# ---- the contents at the header's top name its banners, in their order -----------------------------------------
contents() {
    sed -nE '/^   CONTENTS/,/^   OPTIONS/s/^ {7}([A-Z]( {1,3}[A-Z])*) .*/\1/p' conemap.h >"$dir/contents"
    sed -nE '/^\/\* =+$/{n;s/^ {3}([A-Z]( {1,3}[A-Z])*)$/\1/p}' conemap.h >"$dir/banners"
    [ -s "$dir/banners" ] && diff "$dir/contents" "$dir/banners"
}
part "contents" contents

# ---- warnings: every compiler and standard, with and without the implementation, shared and static --------
sources() {
    cat >"$work/use.c" <<'END'
#include "conemap.h"
int main(void) { return conemap_result_string(CONEMAP_OK) == 0; }
END
    printf '#define CONEMAP_IMPLEMENTATION\n#include "conemap.h"\n' >"$work/impl.c"
    printf '#define CONEMAP_STATIC\n#define CONEMAP_IMPLEMENTATION\n#include "conemap.h"\nint other(void);\nint other(void) { conemap_free(0); return 0; }\n' >"$work/static.c"
    local f
    for f in use impl static; do cp "$work/$f.c" "$work/$f.cc"; done
}
sources

warnings() { # COMPILER STANDARD SUFFIX: all levels for the oldest standards; for the others what the language itself warns of
    local f o levels=-fsyntax-only
    case "$2" in c99 | c++11) levels="-O0 -O2 -O3" ;; esac
    for f in use impl static; do
        [ $f = static ] && levels=${levels##* } # the highest alone
        for o in $levels; do
            # shellcheck disable=SC2086
            "$1" -std="$2" $warn $o -I. -c "$work/$f.$3" -o "$dir/w.o" || return 1
        done
    done
}
for compiler in gcc clang; do
    for standard in c99 c11 gnu99 gnu17; do
        need "warnings $compiler $standard" $compiler && part "warnings $compiler $standard" warnings $compiler $standard c
    done
done
for compiler in g++ clang++; do
    for standard in c++11 c++14 c++17 c++20 gnu++17; do
        need "warnings $compiler $standard" $compiler && part "warnings $compiler $standard" warnings $compiler $standard cc
    done
done

crowded() { # the macros that some system headers define
    # shellcheck disable=SC2086
    gcc -std=c99 $warn -Dnear= -Dfar= -Dsmall=char -Dinterface=struct -DIN= -DOUT= -Dmin=minimum -Dmax=maximum -I. \
        -c "$work/impl.c" -o "$dir/w.o"
}
need "builds among other headers' macros" gcc && part "builds among other headers' macros" crowded

tests_and_examples() { # COMPILER
    local f
    for f in tests/*.c examples/*.c; do
        case "$f" in *stb_image_impl.c | *threads_*.c) continue ;; esac
        # shellcheck disable=SC2086
        "$1" -std=c99 $warn $strict "$2" -I. -c "$f" -o "$dir/w.o" || return 1
    done
}
need "warnings in tests and examples, gcc" gcc && part "warnings in tests and examples, gcc" tests_and_examples gcc -fsyntax-only
need "warnings in tests and examples, clang" clang &&
    part "warnings in tests and examples, clang" tests_and_examples clang -fsyntax-only

# ---- the header leaks nothing but conemap_ and CONEMAP_ ---------------------------------------------------
leaks() {
    printf '#include <stddef.h>\n#include <stdint.h>\n#include <math.h>\n#include <string.h>\n#include <stdlib.h>\n#ifdef __SSE2__\n#include <immintrin.h>\n#endif\n' >"$dir/base.c"
    cat "$dir/base.c" "$work/impl.c" >"$dir/leak.c"
    gcc -dM -E -I. "$dir/base.c" | sort >"$dir/base.txt"
    gcc -dM -E -I. "$dir/leak.c" | sort >"$dir/leak.txt"
    ! comm -13 "$dir/base.txt" "$dir/leak.txt" | awk '{print $2}' | grep -v '^CONEMAP_' || return 1
    # Private macros are all undefined again.
    ! comm -13 "$dir/base.txt" "$dir/leak.txt" | awk '{print $2}' | grep '^CONEMAP__' || return 1
    gcc -fno-pic -c -I. "$work/impl.c" -o "$dir/leak.o" # position-independent code puts constants among the data
    ! nm -g --defined-only "$dir/leak.o" | awk '{print $3}' | grep -v '^conemap_' || return 1
    ! nm -g --defined-only "$dir/leak.o" | awk '{print $3}' | grep '^conemap__' || return 1
    ! nm "$dir/leak.o" | grep -iE ' [bd] ' # no mutable globals
}
need "no leaked names, no mutable globals" gcc nm && part "no leaked names, no mutable globals" leaks

# ---- the suite under other compilers, levels and targets ------------------------------------------------------
suite_run() { # RUNNER COMPILER FLAGS...
    local runner=$1 compiler=$2
    shift 2
    # shellcheck disable=SC2086
    $compiler -I. -DSTABILITY_RAYS=60000 "$@" $suite -o "$dir/suite" -lm || return 1
    local area
    for area in ${CHECK_FILTER:-/}; do $runner "$dir/suite" "$area" || return 1; done
}
CHECK_FILTER=
# Slow ones, and those that differ little from others, leave out the largest areas, but not the guarantees.
quicker="truth/ updates/ stability/ formats/ samples/ tracers/ builds/ inputs/ header/ directional/ kernels/ frusta/ effects/ plan/ packets/"
need "suite clang -O2" clang && part "suite clang -O2" suite_run "" clang -std=c99 $strict -O2 -DVERIFY_SIDE=128
need "suite gcc -O0" gcc && suite=$whole CHECK_FILTER=$quicker part "suite gcc -O0" suite_run "" gcc -std=c99 $strict -O0
need "suite gcc -O3 -march=native" gcc && CHECK_FILTER=$quicker part "suite gcc -O3 -march=native" suite_run "" gcc -std=gnu11 $strict -O3 -march=native
need "suite clang -O3 -march=native" clang && CHECK_FILTER=$quicker part "suite clang -O3 -march=native" suite_run "" clang -std=gnu11 $strict -O3 -march=native
need "suite g++ -std=c++11" g++ && CHECK_FILTER=$quicker part "suite g++ -std=c++11" suite_run "" "g++ -x c++" -std=c++11 $strict -O2
need "suite tcc" tcc && CHECK_FILTER=$quicker part "suite tcc" suite_run "" tcc -std=c99
# These keep the guarantees but not the bits, so only tests of guarantees are asked.
for flags in "-Ofast -march=native" "-O2 -ffast-math"; do
    # shellcheck disable=SC2086
    need "guarantees gcc $flags" gcc && suite=$few CHECK_FILTER="tracers/ stability/" part "guarantees gcc $flags" suite_run "" gcc -std=c99 $flags
done

# ---- instruction sets: every one that a machine or an emulator here has, against plain C ------------------------------
lanes() { # RUNNER COMPILER FLAGS...: the tests of kernels alone
    local runner=$1 compiler=$2
    shift 2
    # shellcheck disable=SC2086
    $compiler -I. -O2 $strict -DTEST_KERNELS_ONLY "$@" tests/main.c tests/kernels.c -o "$dir/suite" -lm &&
        $runner "$dir/suite" kernels/ | tee "$dir/out" && ! grep -q " 0 passed" "$dir/out"
}
for compiler in gcc clang; do
    for mode in -std=gnu17 "-std=gnu11 -march=native"; do
        # shellcheck disable=SC2086
        need "instruction sets $compiler $mode" $compiler && part "instruction sets $compiler $mode" lanes "" $compiler $mode
    done
done
need "instruction sets g++ -std=gnu++17" g++ && part "instruction sets g++ -std=gnu++17" lanes "" "g++ -x c++" -std=gnu++17
need "instruction sets clang++ -std=c++11" clang++ && part "instruction sets clang++ -std=c++11" lanes "" "clang++ -x c++" -std=c++11
need "instruction sets NEON" aarch64-linux-gnu-gcc qemu-aarch64 &&
    part "instruction sets NEON" lanes qemu-aarch64 aarch64-linux-gnu-gcc -std=c99 -static
if grep -q avx512vl /proc/cpuinfo 2>/dev/null; then :; else skip "instruction sets AVX-512" "AVX-512 (compiled only)"; fi
# What a target without a C library is told of one: nothing of this is called by what the test needs.
libm='double atan(double); double sin(double); double cos(double); float sinf(float); float cosf(float); float log2f(float); float powf(float, float); float ceilf(float);'
msvc() { # clang in MSVC mode knows its intrinsics; system headers are missing, so only what is ours is looked at
    mkdir -p "$dir/include"
    printf '#pragma once\ntypedef unsigned long long size_t;\nvoid *memcpy(void *, const void *, size_t);\nvoid *memset(void *, int, size_t);\nint memcmp(const void *, const void *, size_t);\nint strncmp(const char *, const char *, size_t);\nint strcmp(const char *, const char *);\nsize_t strlen(const char *);\n' >"$dir/include/string.h"
    printf '#pragma once\nvoid *malloc(unsigned long long);\nvoid free(void *);\n' >"$dir/include/stdlib.h"
    printf '#pragma once\nvoid *_aligned_malloc(unsigned long long, unsigned long long);\nvoid _aligned_free(void *);\n' >"$dir/include/malloc.h"
    printf '#pragma once\nfloat sqrtf(float);\ndouble sqrt(double);\ndouble floor(double);\nfloat floorf(float);\n%s\n' "$libm" >"$dir/include/math.h"
    clang --target=x86_64-pc-windows-msvc -fms-compatibility-version=19.30 -std=c99 -mavx2 -mavx512f -mavx512bw -mavx512dq -mavx512vl \
        -isystem "$dir/include" -I. -fsyntax-only "$work/impl.c"
}
need "syntax for MSVC" clang && part "syntax for MSVC" msvc
wasm() { # executed in node: plain C against SIMD128
    mkdir -p "$dir/include"
    printf '#include <stddef.h>\nvoid *memcpy(void *, const void *, size_t);\nvoid *memset(void *, int, size_t);\nint memcmp(const void *, const void *, size_t);\nint strncmp(const char *, const char *, size_t);\nint strcmp(const char *, const char *);\nsize_t strlen(const char *);\n' >"$dir/include/string.h"
    printf '#include <stddef.h>\nvoid *malloc(size_t);\nvoid free(void *);\n' >"$dir/include/stdlib.h"
    printf '#define sqrtf __builtin_sqrtf\n#define sqrt __builtin_sqrt\n#define floor __builtin_floor\n%s\n' "$libm" >"$dir/include/math.h"
    cat >"$dir/wasm.c" <<'END'
#include <string.h>
static unsigned char heap[1 << 24];
static size_t used;
void *malloc(size_t size) { void *at = heap + used; used += (size + 15) / 16 * 16; return used <= sizeof heap ? at : 0; }
void free(void *memory) { (void)memory; }
void *memcpy(void *to, const void *from, size_t n) { char *t = to; const char *f = from; while (n--) *t++ = *f++; return to; }
void *memset(void *to, int c, size_t n) { char *t = to; while (n--) *t++ = (char)c; return to; }
int memcmp(const void *a, const void *b, size_t n) { const unsigned char *x = a, *y = b; for (; n; --n, ++x, ++y) if (*x != *y) return *x - *y; return 0; }
#define CONEMAP_IMPLEMENTATION
#include "conemap.h"
/* 0 if all is well: every generator, wrap mode and format, plain C against the best there is. */
__attribute__((export_name("run"))) int run(void) {
    static unsigned short pixels[61 * 47];
    unsigned seed = 1, k;
    int round;
    for (round = 0; round < 48; ++round) {
        conemap_desc desc;
        conemap_map plain, wide;
        used = 0;
        for (k = 0; k < 61 * 47; ++k) {
            seed = seed * 1664525u + 1013904223u;
            pixels[k] = (unsigned short)(round & 1 ? seed >> 16 : 300u * (k % 61u) + (seed >> 19));
        }
        memset(&desc, 0, sizeof desc);
        desc.heights.pixels = pixels;
        desc.heights.format = CONEMAP_UNORM16;
        desc.heights.width = 61 - round;
        desc.heights.height = 47;
        desc.heights.row_stride = 122;
        desc.wrap_u = (conemap_wrap)(round % 3);
        desc.wrap_v = (conemap_wrap)(round / 3 % 3);
        desc.generator = round % 4 == 3 ? CONEMAP_QUICK : round % 8 == 6 ? CONEMAP_RELAXED_EXACT : CONEMAP_EXACT;
        if (round % 8 == 4 || round % 8 == 5) desc.texture.sectors = round % 16 < 8 ? 4 : 8;
        if (round % 4 == 1) desc.guarantee = CONEMAP_GUARANTEE_VERTEX;
        if (round % 4 == 2) desc.slack = 0.1f;
        desc.texture.format = (conemap_format)(round % 4);
        desc.isa = CONEMAP_ISA_SCALAR;
        if (conemap_build(&desc, &plain) != CONEMAP_OK) return 1;
        desc.isa = CONEMAP_ISA_WASM;
        if (conemap_build(&desc, &wide) != CONEMAP_OK || wide.isa != CONEMAP_ISA_WASM) return 2;
        k = (unsigned)(desc.heights.width * desc.heights.height) * (unsigned)sizeof(float);
        if (memcmp(plain.heights, wide.heights, k) != 0) return 100 + round;
        if (memcmp(plain.cones, wide.cones, desc.texture.sectors ? k * (unsigned)desc.texture.sectors : k) != 0) return 200 + round;
    }
    return 0;
}
END
    clang --target=wasm32 -O2 -msimd128 -nostdlib -ffreestanding -fno-builtin -ffp-contract=off -isystem "$dir/include" -I. \
        -Wl,--no-entry "$dir/wasm.c" -o "$dir/wasm.wasm" || return 1
    have node || { echo "compiled only: no node"; return 0; }
    node -e 'const fs = require("fs"); WebAssembly.instantiate(fs.readFileSync(process.argv[1]), {}).then(m => {
        const r = m.instance.exports.run(); console.log("result", r); process.exit(r === 0 ? 0 : 1); })' "$dir/wasm.wasm"
}
need "instruction sets WebAssembly" clang wasm-ld && part "instruction sets WebAssembly" wasm

# ---- sanitizers and valgrind ----------------------------------------------------------------------------------
sanitize="-std=c99 $strict -g -fsanitize=address,undefined -fno-sanitize-recover=all"
# The two share the areas; what reads what comes from outside is in both. clang takes minutes to optimise what it instruments.
need "sanitizers clang" clang &&
    CHECK_FILTER="safe/ shading/ emit_frusta/ formats/ inputs/" part "sanitizers clang" suite_run "" clang -O0 $sanitize
need "sanitizers gcc" gcc && CHECK_FILTER="$quicker oracle/ verify/ emit/" part "sanitizers gcc" suite_run "" gcc -O1 $sanitize
valgrind_run() {
    # shellcheck disable=SC2086
    gcc -std=c99 $strict -DSTABILITY_RAYS=30000 -g -O2 -I. $few -o "$dir/suite" -lm || return 1
    local area
    for area in formats/ builds/ inputs/ samples/ safe/bands; do
        valgrind -q --error-exitcode=9 --leak-check=full "$dir/suite" $area || return 1
    done
}
need "valgrind" valgrind gcc && part "valgrind" valgrind_run

# ---- foreign targets in emulators: 32 bit, big-endian, other float units -----------------------------------------
# An emulator was once seen to hang where it did not the next four times: one that runs out of time gets a second try.
emulated() {
    timeout 300 "$@"
    local status=$?
    [ $status = 124 ] || return $status
    echo "out of time, once more: $*"
    timeout 300 "$@"
}
foreign() { # COMPILER EMULATOR FLAGS...
    local compiler=$1 emulator=$2
    shift 2
    # shellcheck disable=SC2086
    $compiler -std=c99 -static -O1 $strict -DSTABILITY_RAYS=30000 -I. "$@" $few -o "$dir/foreign" -lm || return 1
    local area
    for area in formats/ inputs/ samples/ safe/bands "safe/relaxed c" updates/errors; do emulated $emulator "$dir/foreign" "$area" || return 1; done
}
for target in aarch64:aarch64-linux-gnu: s390x:s390x-linux-gnu:-fexcess-precision=fast ppc64:powerpc64-linux-gnu: riscv64:riscv64-linux-gnu: \
    arm:arm-linux-gnueabihf:-mfpu=neon i386:i686-linux-gnu:"-msse2 -mfpmath=sse"; do
    IFS=: read -r machine triple flags <<<"$target"
    need "target $triple" "$triple-gcc" "qemu-$machine" &&
        part "target $triple" foreign "$triple-gcc" "qemu-$machine" $flags
done
x87() {
    # shellcheck disable=SC2086
    i686-linux-gnu-gcc -std=c99 -static -O2 -mfpmath=387 -mno-sse -DSTABILITY_RAYS=30000 -I. $few -o "$dir/foreign" -lm || return 1
    qemu-i386 "$dir/foreign" tracers/vertical && qemu-i386 "$dir/foreign" stability
}
need "guarantees x87" i686-linux-gnu-gcc qemu-i386 && part "guarantees x87" x87
windows() {
    # shellcheck disable=SC2086
    x86_64-w64-mingw32-gcc -std=c99 -O2 $strict $warn -I. $suite -o "$dir/suite.exe"
}
need "builds for Windows" x86_64-w64-mingw32-gcc && part "builds for Windows" windows

# ---- thirty million hard rays, a hundred with LONG=1: no miss with what is proven, and what is not is found out --------
rays=${STABILITY_RAYS:-30000000} proven=1500000 frusta_rays=${FRUSTA_RAYS:-300000}
[ -n "${LONG:-}" ] && rays=100000000 proven=10000000 frusta_rays=1000000
in_parts() { # PROGRAM ARGUMENTS...: a process for each processor, told its number and how many there are; outputs: part.*
    local parts part pids="" bad=0
    parts=$(nproc 2>/dev/null || echo 2)
    rm -f "$dir"/part.*
    for ((part = 0; part < parts; ++part)); do
        "$@" $part "$parts" >"$dir/part.$part" &
        pids="$pids $!"
    done
    for part in $pids; do wait "$part" || bad=1; done
    return $bad
}
stability() {
    local bad=0
    # shellcheck disable=SC2086
    gcc -std=c99 -O2 $strict -DSTABILITY_MAIN -DSTABILITY_RAYS=$rays -I. tests/stability.c \
        -o "$dir/stability" -lm || return 1
    in_parts "$dir/stability" || bad=1
    tail -qn 1 "$dir"/part.* | awk '{r+=$1; m+=$3; f+=$5} END {print r " rays, " m " misses, " f " false hits"}' | tee -a "$work/counts"
    [ $bad = 0 ] || { grep -h '^tests/stability' "$dir"/part.* | head; return 1; }
}
need "stability, $rays rays" gcc && part "stability, $rays rays" stability

# ---- bilinear cells of guaranteed maps, proven empty by bound; ten million with LONG=1 --------------------------------
cells() {
    local bad=0
    # shellcheck disable=SC2086
    gcc -std=c99 -O2 $strict -I. tests/long/cells.c -o "$dir/cells" -lm || return 1
    in_parts "$dir/cells" $proven || bad=1
    tail -qn 1 "$dir"/part.* | tee -a "$work/counts"
    [ $bad = 0 ] || { cat "$dir"/part.*; return 1; }
}
need "cells, $proven by bound" gcc && part "cells, $proven by bound" cells

# ---- ten million shadow rays: no leak, no false shadow; a flight away from a map: no frame that pops ------------------
shadows() {
    local bad=0
    # shellcheck disable=SC2086
    gcc -std=c99 -O2 $strict -I. tests/long/shadows.c -o "$dir/shadows" -lm || return 1
    in_parts "$dir/shadows" "${SHADOW_RAYS:-10000000}" || bad=1
    tail -qn 1 "$dir"/part.* | awk '{r+=$1; d+=$4; l+=$8; f+=$10} END {print r " shadow rays, " d " dark, " l " leaks, " f " false shadows"}' |
        tee -a "$work/counts"
    [ $bad = 0 ] || { cat "$dir"/part.*; return 1; }
}
need "shadows, 10 million rays" gcc && part "shadows, 10 million rays" shadows
flight() {
    # shellcheck disable=SC2086
    gcc -std=c99 -O2 $strict -I. tests/long/flight.c -o "$dir/flight" -lm || return 1
    "$dir/flight"
}
need "flight away from levels" gcc && part "flight away from levels" flight

# ---- how near the safe cones come to the widest that are safe; their steps ------------------------------------------
aperture() {
    # shellcheck disable=SC2086
    gcc -std=c99 -O2 $strict -I. tests/long/aperture.c -o "$dir/aperture" -lm || return 1
    "$dir/aperture"
}
need "aperture of safe cones" gcc && part "aperture of safe cones" aperture

# ---- rays against frusta, a million with LONG=1, and as many times the quick run's relief --------------------------------
frusta() {
    make -s build/tests || return 1
    FRUSTA_RAYS=$frusta_rays ./build/tests frusta/ | tee -a "$dir/out" || return 1
    grep -q ' 0 failed' "$dir/out"
}
need "frusta, $frusta_rays rays" gcc && part "frusta, $frusta_rays rays" frusta

# ---- fuzzing: baked bytes and build settings --------------------------------------------------------------------
fuzz() {
    clang -std=c99 -g -O0 -fsanitize=fuzzer,address,undefined -I. tests/long/fuzz.c -o "$dir/fuzz" -lm || return 1
    mkdir -p "$dir/corpus"
    "$dir/fuzz" -seed=1 -runs=40000 -max_len=700 -max_total_time=60 "$dir/corpus"
}
need "fuzz smoke" clang && part "fuzz smoke" fuzz

# ---- emitted shaders through real compilers, and on a software GPU -----------------------------------------------------
shaders() { # PART [WRITER]
    sh tests/gpu/shaders.sh "$1" "$dir" "${2:-}" || return $?
    cat "$dir/count" >>"$work/counts"
}
need "shaders in C" gcc && part "shaders in C" shaders c
need "shaders in GLSL" gcc glslangValidator spirv-val && part "shaders in GLSL" shaders glsl
need "frusta shaders in C" gcc && part "frusta shaders in C" shaders c frusta_variants
need "frusta shaders in GLSL" gcc glslangValidator spirv-val && part "frusta shaders in GLSL" shaders glsl frusta_variants
need "shaders in MSL" gcc clang++ && SHADER_SAMPLES=${SHADER_SAMPLES:-150} part "shaders in MSL" shaders msl
need "frusta shaders in MSL" gcc clang++ && SHADER_SAMPLES=${SHADER_SAMPLES:-100} part "frusta shaders in MSL" shaders msl frusta_variants
# MSL is run as C++, with tests/gpu/metal_stdlib in Metal's place.
metal() {
    gcc -std=c99 -O2 -I. tests/gpu/dialects.c -o "$dir/writer" -lm && "$dir/writer" texts "$dir" &&
        clang++ -x c++ -std=c++14 -O1 -ffp-contract=off -Wno-unknown-attributes -I. -Itests/gpu -I"$dir" \
            -DCALLS='"calls.h"' tests/gpu/dialects.c -o "$dir/run" || return 1
    "$dir/run" run || return 1
    tail -n 1 "$dir/log" >>"$work/counts"
}
need "shaders in MSL, run" gcc clang++ && part "shaders in MSL, run" metal
# WGSL_MODULES: the folder that npm put webgpu@0.6.2 and naga-wasm@30.1.0 into, or npm is asked for them.
modules() {
    [ -n "${WGSL_MODULES:-}" ] && return 0
    WGSL_MODULES=$PWD/$work/npm/node_modules
    export WGSL_MODULES
    [ -d "$WGSL_MODULES/naga-wasm" ] && return 0
    mkdir -p "$work/npm"
    (cd "$work/npm" && echo '{}' >package.json &&
        timeout 300 npm install --silent --ignore-scripts webgpu@0.6.2 naga-wasm@30.1.0 >/dev/null 2>&1)
}
webgpu() { # on SwiftShader, which comes with Chromium
    gcc -std=c99 -O2 -I. tests/gpu/dialects.c -o "$dir/dialects" -lm && "$dir/dialects" write "$dir" || return 1
    mkdir -p "$dir/xdg"
    XDG_RUNTIME_DIR=$PWD/$dir/xdg VK_ICD_FILENAMES=$swiftshader \
        node tests/gpu/wgsl.mjs "$WGSL_MODULES" run "$dir" || return $?
    "$dir/dialects" compare "$dir" || return 1
    rm -f "$dir"/*.in "$dir"/*.out
    tail -n 1 "$dir/log" >>"$work/counts"
}
swiftshader=${SWIFTSHADER:-/usr/lib/chromium/vk_swiftshader_icd.json}
case "frusta shaders in WGSL, run" in
*"$only"*)
    if need "shaders in WGSL" gcc node npm; then
        if modules; then
            SHADER_SAMPLES=${SHADER_SAMPLES:-150} part "shaders in WGSL" shaders wgsl
            SHADER_SAMPLES=${SHADER_SAMPLES:-100} part "frusta shaders in WGSL" shaders wgsl frusta_variants
            if [ -f "$swiftshader" ]; then
                part "shaders in WGSL, run" webgpu
            else
                skip "shaders in WGSL, run" "SwiftShader (Chromium's; SWIFTSHADER can name its ICD file)"
            fi
        else
            skip "shaders in WGSL" "webgpu and naga-wasm (npm could not fetch them; WGSL_MODULES can name a folder)"
        fi
    fi
    ;;
esac
# HLSL_DLLS: a folder with Microsoft's compilers, or npm fetches the packages that hold them.
dlls() {
    [ -n "${HLSL_DLLS:-}" ] && return 0
    HLSL_DLLS=$PWD/$work/dlls
    export HLSL_DLLS
    [ -f "$HLSL_DLLS/msdxc.dll" ] && return 0
    have npm || return 1
    mkdir -p "$HLSL_DLLS"
    (
        cd "$HLSL_DLLS" || exit 1
        timeout 300 npm pack --silent webgpu@0.6.2 gl@8.1.6 >/dev/null 2>&1 || exit 1
        tar xzf webgpu-0.6.2.tgz --strip-components=3 package/dist/win32-x64/d3dcompiler_47.dll package/dist/win32-x64/dxcompiler.dll || exit 1
        mv d3dcompiler_47.dll msfxc.dll
        tar xzf gl-8.1.6.tgz --strip-components=5 package/deps/windows/dll/x64/d3dcompiler_47.dll || exit 1
        mv d3dcompiler_47.dll msfxc_old.dll
        mv dxcompiler.dll msdxc.dll
        rm -f ./*.tgz
    )
}
case "frusta shaders in HLSL" in
*"$only"*)
    if ! have x86_64-w64-mingw32-gcc || { ! have wine64 && [ ! -x /usr/lib/wine/wine64 ]; }; then
        skip "shaders in HLSL" "wine64 and mingw"
    elif ! dlls; then
        skip "shaders in HLSL" "Microsoft compilers (npm could not fetch them; HLSL_DLLS can name a folder)"
    else
        SHADER_SAMPLES=${SHADER_SAMPLES:-60} part "shaders in HLSL" shaders hlsl
        part "frusta shaders in HLSL" shaders hlsl frusta_variants
    fi
    ;;
esac
# HLSL run: Microsoft's compiler that writes SPIR-V (a large package), or glslang's.
spirv_dll() {
    HLSL_DLLS=${HLSL_DLLS:-$PWD/$work/dlls}
    export HLSL_DLLS
    [ -f "$HLSL_DLLS/msdxc_spirv.dll" ] && return 0
    have npm || return 1
    mkdir -p "$HLSL_DLLS"
    (
        cd "$HLSL_DLLS" || exit 1
        timeout 300 npm pack --silent onnxruntime-node@1.30.0 >/dev/null 2>&1 &&
            tar xzf onnxruntime-node-1.30.0.tgz --strip-components=5 package/bin/napi-v6/win32/x64/dxcompiler.dll &&
            mv dxcompiler.dll msdxc_spirv.dll
        rm -f ./*.tgz
        [ -f msdxc_spirv.dll ]
    )
}
hlsl_run() {
    if have x86_64-w64-mingw32-gcc && { have wine64 || [ -x /usr/lib/wine/wine64 ]; } && spirv_dll; then echo "through Microsoft's compiler"; fi
    shaders hlslrun
}
gpu_part() { # NAME COMMAND: exits with 77 where there is no software GPU
    if have gcc && echo '#include <EGL/egl.h>' | gcc -E - >/dev/null 2>&1; then part "$@"; else skip "$1" "EGL headers"; fi
}
need "shaders in HLSL, run" gcc spirv-cross glslangValidator && gpu_part "shaders in HLSL, run" hlsl_run
software_gpu() {
    gcc -std=c99 -O2 -I. tests/gpu/gl.c -o "$dir/gl" -lEGL -lm || return 1
    EGL_PLATFORM=surfaceless "$dir/gl" || return $?
    tail -n 1 "$dir/log" >>"$work/counts"
}
gpu_part "shaders on a software GPU" software_gpu
effects_on_gpu() { # the sheet of examples/effects.c by the CPU and by the shader, and what each effect costs
    gcc -std=c99 -O2 -I. tests/gpu/effects.c -o "$dir/effects" -lEGL -lm || return 1
    EGL_PLATFORM=surfaceless "$dir/effects" "$dir" || return $?
    tail -n 1 "$dir/log" >>"$work/counts"
    EGL_PLATFORM=surfaceless "$dir/effects" cost "$dir" | sed 's/^/cost  /' | tee -a "$work/counts"
}
gpu_part "effects on a software GPU" effects_on_gpu
pairs_by_shaders() { # every effect, every pair, and each storage; polygons
    gcc -std=c99 -O1 -I. tests/gpu/agree.c -o "$dir/agree" -lEGL -lm || return 1
    EGL_PLATFORM=surfaceless "$dir/agree" "$dir" || return $?
    EGL_PLATFORM=surfaceless "$dir/agree" es "$dir" || return $?
    grep '^effects by' "$dir/log" >>"$work/counts"
}
gpu_part "pairs of effects on a software GPU" pairs_by_shaders
pairs_in_c() { # the same sets as emitted C; and that what traces alone, in a static build, holds no effect
    gcc -std=c99 -O0 -I. tests/gpu/agree_c.c -o "$dir/write" -lm && "$dir/write" >"$dir/agree.h" || return 1
    gcc -std=c99 -O0 $strict -I. "-DAGREE_TEXT=\"$dir/agree.h\"" tests/gpu/agree_c.c -o "$dir/agree" -lm || return 1
    "$dir/agree" || return 1
    tail -n 1 "$dir/log" >>"$work/counts"
    gcc -std=c99 -O2 -I. -c examples/bench_off.c -o "$dir/without.o" || return 1
    ! nm "$dir/without.o" | grep -E 'shade|emit|conemap__fly'
}
need "pairs of effects in C" gcc nm && part "pairs of effects in C" pairs_in_c
frusta_gpu() {
    gcc -std=c99 -O2 -I. tests/gpu/frusta_gl.c -o "$dir/frusta_gl" -lEGL -lm || return 1
    EGL_PLATFORM=surfaceless "$dir/frusta_gl" "$dir"
}
gpu_part "frusta on a software GPU" frusta_gpu

# ---- the examples as a person runs them ---------------------------------------------------------------------------
need "examples" make && part "examples" sh tests/examples.sh
# Builds by many threads: the same bits, and no data race.
threads() {
    make threads || return 1
    gcc -std=c99 -g -O1 -fsanitize=thread -I. -pthread examples/threads_pthreads.c -o "$dir/pthreads" -lm && "$dir/pthreads" || return 1
    g++ -std=c++11 -g -O1 -fsanitize=thread -I. -pthread examples/threads_pool.cc -o "$dir/pool" && "$dir/pool"
}
need "threads" make gcc g++ && part "threads" threads
elsewhere() { # a clean copy in a folder whose name has spaces
    local copy="$dir/a folder with spaces"
    rm -rf "$copy"
    mkdir -p "$copy"
    cp -r conemap.h Makefile tests examples "$copy/"
    make -C "$copy" build/hello && make -C "$copy" demo && make -C "$copy" clean
}
need "clean copy in a path with spaces" make && part "clean copy in a path with spaces" elsewhere

wait
[ -f "$work/counts" ] && sed 's/^/counted  /' "$work/counts"
count() { cat "$work/$1" 2>/dev/null | wc -l; }
printf '%d parts ok, %d failed, %d skipped\n' "$(count ok)" "$(count failed)" "$(count skipped)"
[ "$(count failed)" = 0 ]
