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

EXAMPLES = hello bake render inspect accuracy bench
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
	@echo "make all       builds the examples and the tests"
	@echo "make clean     removes build/ and out/"

build out:
	@mkdir -p $@

build/hello: examples/hello.c conemap.h | build
	$(COMPILE) examples/hello.c -o $@ $(LINK)

build/stb_image_impl.o: examples/stb_image_impl.c | build
	$(CC) -w $(CFLAGS) -DHAVE_STB_IMAGE -c examples/stb_image_impl.c -o $@

$(filter-out build/hello,$(PROGRAMS)): build/%: examples/%.c examples/common.h examples/measure.h examples/bench_trace.h tests/truth.h conemap.h $(STB_OBJ) | build
	$(COMPILE) $(STB_FLAGS) $< $(STB_OBJ) -o $@ $(LINK)

build/%.o: tests/%.c $(wildcard tests/*.h) conemap.h | build
	$(COMPILE) -c $< -o $@

build/tests: $(TESTS:tests/%.c=build/%.o)
	$(CC) $(CFLAGS) $^ -o $@ $(LINK)

test: build/tests
	@./build/tests $(TEST)

demo: build/bake build/render build/inspect | out
	@sh examples/demo.sh

check:
	@CC="$(CC)" CXX="$(CXX)" bash tests/check.sh $(CHECK)

bench: build/bench
	@./build/bench $(BENCH)

accuracy: build/accuracy | out
	@./build/accuracy $(MAP)

clean:
	rm -rf build out

.PHONY: all help test demo check bench accuracy clean
