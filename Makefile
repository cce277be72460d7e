# conemap.h: `make help` lists what there is. Only relative paths, so any folder name will do.

CC      ?= cc
CXX     ?= c++
CFLAGS  ?= -O2
# No fused multiply-add in the tests' own reference arithmetic; empty it for compilers that lack the option.
STRICT  ?= -ffp-contract=off
WARN     = -Wall -Wextra -Wpedantic -Wconversion -Wsign-conversion -Wshadow -Wundef
COMPILE  = $(CC) -std=c99 $(WARN) $(STRICT) $(CFLAGS) -I.
LINK     = -lm

# PNG, JPG, TGA and HDR input where the system has stb_image.h; PGM, PPM, PFM and raw files always.
STB     := $(firstword $(wildcard /usr/include/stb/stb_image.h /usr/local/include/stb/stb_image.h))
ifneq ($(STB),)
STB_FLAGS = -DHAVE_STB_IMAGE
STB_OBJ   = build/stb_image_impl.o
endif

EXAMPLES = hello bake render inspect accuracy bench tree effects emit
PROGRAMS = $(EXAMPLES:%=build/%)
TESTS    = $(wildcard tests/*.c)
JACKSBORO = examples/jacksboro_403x344_16bit.pgm

all: $(PROGRAMS) build/tests

help:
	@echo "make demo      bakes and renders the elevation model and two procedural maps; pictures in out/"
	@echo "make test      the self-contained tests, under a minute"
	@echo "make check     everything heavier: warnings, sanitizers, other targets, fuzzing; skips what is missing"
	@echo "make bench     speed, one line per figure (BENCH=name for those whose name holds it)"
	@echo "make accuracy  what accuracy costs in time"
	@echo "make fit       measures the planner's table anew and writes it into conemap.h"
	@echo "make threads   the builds by many threads: POSIX threads, C11 threads, a pool of C++ threads"
	@echo "make effects   a picture of each effect on one sheet: out/effects.png"
	@echo "make shaders   all combinations of a shader's options through the shader compilers; takes hours"
	@echo "make sync      writes tests/golden/ anew from the shader emitter"
	@echo "make all       builds the examples and the tests"
	@echo "make trees     plants and cacti as relief-mapped frusta; pictures in out/"
	@echo "make clean     removes build/ and out/"

build out:
	@mkdir -p $@

build/hello: examples/hello.c conemap.h | build
	$(COMPILE) examples/hello.c -o $@ $(LINK)

build/stb_image_impl.o: examples/stb_image_impl.c | build
	$(CC) -w $(CFLAGS) -DHAVE_STB_IMAGE -c examples/stb_image_impl.c -o $@

# The tracer in a build with effects and in one without, which is how the bench tells what those cost that are off.
OFF_OBJ = build/bench_with.o build/bench_without.o
$(OFF_OBJ): examples/bench_off.c examples/bench_off.h conemap.h | build
	$(COMPILE) $(if $(findstring without,$@),,-DWITH_EFFECTS) -c $< -o $@
build/bench: $(OFF_OBJ)

$(filter-out build/hello,$(PROGRAMS)): build/%: examples/%.c $(wildcard examples/*.h) $(wildcard tests/*.h) conemap.h $(STB_OBJ) | build
	$(COMPILE) $(STB_FLAGS) $< $(STB_OBJ) $(filter $(OFF_OBJ),$^) -o $@ $(LINK)

build/%.o: tests/%.c $(wildcard tests/*.h) conemap.h | build
	$(COMPILE) -c $< -o $@

# The C that the emitter writes is compiled into these tests; the same sources, without what reads it, write it first.
WRITERS  = tests/emit.c tests/emit_frusta.c tests/shading.c

build/write: CFLAGS = -O0
build/write: tests/main.c $(WRITERS) $(wildcard tests/*.h) conemap.h | build
	$(COMPILE) -DTEST_WRITE tests/main.c $(WRITERS) -o $@ $(LINK)

build/written/done: build/write
	@mkdir -p build/written
	@./build/write > $@ || { cat $@; rm $@; exit 1; }

$(WRITERS:tests/%.c=build/%.o): build/written/done

build/static_%.o: CFLAGS = -O0 # whole copies of the library of which little runs

build/tests: $(TESTS:tests/%.c=build/%.o)
	$(CC) $(CFLAGS) $^ -o $@ $(LINK)

test:
	@$(MAKE) -s $(if $(findstring j,$(MAKEFLAGS)),,-j2) build/tests
	@sh tests/run.sh $(TEST)

sync: build/tests
	@CONEMAP_SYNC=1 ./build/tests "/golden files"

demo: build/bake build/render build/inspect | out
	@sh examples/demo.sh

# What a machine's compiler lacks is left out, with a line.
threads: | build
	@$(COMPILE) -pthread examples/threads_pthreads.c -o build/threads_pthreads $(LINK) && build/threads_pthreads
	@if echo '#include <threads.h>' | $(CC) -std=c11 -E - >/dev/null 2>&1; then \
	    $(CC) -std=c11 $(WARN) $(CFLAGS) -I. -pthread examples/threads_c11.c -o build/threads_c11 $(LINK) && build/threads_c11; \
	else echo "skipped threads_c11: no threads.h"; fi
	@if $(CXX) --version >/dev/null 2>&1; then \
	    $(CXX) -std=c++11 $(WARN) $(CFLAGS) -I. -pthread examples/threads_pool.cc -o build/threads_pool && build/threads_pool; \
	else echo "skipped threads_pool: no C++ compiler"; fi

check:
	@CC="$(CC)" CXX="$(CXX)" bash tests/check.sh $(CHECK)

# Hours: every combination of tracer, refinement, format, wrap and effect through every shader compiler there is.
shaders:
	@CC="$(CC)" CXX="$(CXX)" SHADER_SAMPLES=-1 bash tests/check.sh "shaders in "

bench: build/bench
	@./build/bench $(BENCH)

effects: build/effects | out
	@./build/effects out/effects.png

accuracy: build/accuracy | out
	@./build/accuracy $(MAP)

# The planner's table in conemap.h, measured and fitted on this machine; a quiet one, please.
fit: build/accuracy
	@./build/accuracy --fit > build/plan_rows
	@sed -e '/^static const conemap__plan_row /r build/plan_rows' -e '/^static const conemap__plan_row /,/^};/d' \
	    conemap.h > build/conemap.h
	@cp build/conemap.h conemap.h && rm build/conemap.h

trees: build/tree | out
	@./build/tree

clean:
	rm -rf build out

.PHONY: all help shaders test demo threads check bench accuracy fit clean trees effects sync
