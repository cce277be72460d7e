/* Compiles HLSL with Microsoft's own compilers under Windows or wine:  hlsl LIBRARY.dll PROFILE FILE...
   where a PROFILE of 5_0 means d3dcompiler's D3DCompile with ps_5_0 (or cs_5_0, vs_5_0 for names that hold "compute",
   "vertex") and 6_0 dxcompiler's DxcCreateInstance. A warning counts as a failure. PROFILE spirv is 6_0 and writes FILE.spv
   beside each FILE, with registers t at 0, u at 8, s at 16, b at 24. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <windows.h>

typedef struct blob blob;
typedef struct blob_table {
    HRESULT(WINAPI *query)(blob *, const GUID *, void **);
    ULONG(WINAPI *add)(blob *);
    ULONG(WINAPI *release)(blob *);
    void *(WINAPI *pointer)(blob *);
    SIZE_T(WINAPI *size)(blob *);
} blob_table;
struct blob {
    const blob_table *table;
};
typedef HRESULT(WINAPI *compile_function)(const void *, SIZE_T, const char *, const void *, void *, const char *,
                                          const char *, UINT, UINT, blob **, blob **);

/* The part of dxcompiler's interfaces that is needed. */
typedef struct dxc_result dxc_result;
typedef struct dxc_result_table {
    void *query, *add;
    ULONG(WINAPI *release)(dxc_result *);
    HRESULT(WINAPI *status)(dxc_result *, HRESULT *);
    HRESULT(WINAPI *result)(dxc_result *, blob **);
    HRESULT(WINAPI *errors)(dxc_result *, blob **);
} dxc_result_table;
struct dxc_result {
    const dxc_result_table *table;
};
typedef struct dxc_buffer {
    const void *pointer;
    SIZE_T size;
    UINT encoding;
} dxc_buffer;
typedef struct dxc dxc;
typedef struct dxc_table {
    void *query, *add, *release;
    HRESULT(WINAPI *compile)(dxc *, const dxc_buffer *, const wchar_t **, UINT, void *, const GUID *, void **);
} dxc_table;
struct dxc {
    const dxc_table *table;
};
typedef HRESULT(WINAPI *create_function)(const GUID *, const GUID *, void **);

static const GUID class_compiler = {0x73e22d93, 0xe6ce, 0x47f3, {0xb5, 0xbf, 0xf0, 0x66, 0x4f, 0x39, 0xc1, 0xb0}};
static const GUID interface_compiler3 = {
    0x228b4687, 0x5a6a, 0x4730, {0x90, 0x0c, 0x97, 0x02, 0xb2, 0x20, 0x3f, 0x54}};
static const GUID interface_operation_result = {
    0xcedb484a, 0xd4e9, 0x445a, {0xb9, 0x91, 0xca, 0x21, 0xca, 0x15, 0x7d, 0xc2}};

static char *load(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    char *bytes;
    if (!file) return NULL;
    fseek(file, 0, SEEK_END);
    *size = (size_t)ftell(file);
    fseek(file, 0, SEEK_SET);
    bytes = (char *)malloc(*size + 1);
    if (bytes && fread(bytes, 1, *size, file) != *size) *size = 0;
    fclose(file);
    return bytes;
}

int main(int argument_count, char **arguments)
{
    HMODULE library;
    dxc *compiler = NULL;
    compile_function compile = NULL;
    int k, good = 0, bad = 0;
    if (argument_count < 4) return 2;
    library = LoadLibraryA(arguments[1]);
    if (!library) {
        printf("hlsl: %s cannot be loaded\n", arguments[1]);
        return 2;
    }
    if (arguments[2][0] == '5') {
        compile = (compile_function)(void *)GetProcAddress(library, "D3DCompile");
    } else {
        create_function create = (create_function)(void *)GetProcAddress(library, "DxcCreateInstance");
        if (create) create(&class_compiler, &interface_compiler3, (void **)&compiler);
    }
    if (!compile && !compiler) return 2;
    for (k = 3; k < argument_count; ++k) {
        size_t size = 0;
        char *text = load(arguments[k], &size), profile[16];
        blob *code = NULL, *errors = NULL;
        HRESULT result = E_FAIL;
        const int compute = strstr(arguments[k], "compute") != NULL, vertex = strstr(arguments[k], "vertex") != NULL;
        if (!text) return 2;
        snprintf(profile, sizeof profile, "%s_%s", compute ? "cs" : vertex ? "vs" : "ps", arguments[2]);
        if (compile) {
            result = compile(text, size, arguments[k], NULL, NULL, "main", profile, 0, 0, &code, &errors);
        } else {
            const wchar_t *flags[] = {L"-E", L"main", L"-T",
                                      compute  ? L"cs_6_0"
                                      : vertex ? L"vs_6_0"
                                               : L"ps_6_0",
                                      L"-Vd", L"-spirv", L"-fvk-u-shift", L"8", L"0", L"-fvk-s-shift", L"16", L"0",
                                      L"-fvk-b-shift", L"24", L"0"};
            const int spirv = arguments[2][0] == 's';
            dxc_buffer buffer = {text, size, 65001};
            dxc_result *answer = NULL;
            result = compiler->table->compile(compiler, &buffer, flags, spirv ? 15 : 5, NULL, &interface_operation_result,
                                              (void **)&answer);
            if (result >= 0 && answer) {
                answer->table->status(answer, &result);
                answer->table->errors(answer, &errors);
                if (spirv && result >= 0 && answer->table->result(answer, &code) >= 0 && code) {
                    char path[600];
                    FILE *file;
                    snprintf(path, sizeof path, "%s.spv", arguments[k]);
                    file = fopen(path, "wb");
                    if (!file || fwrite(code->table->pointer(code), 1, code->table->size(code), file) == 0) result = E_FAIL;
                    if (file) fclose(file);
                }
                answer->table->release(answer);
            }
        }
        if (errors && errors->table->size(errors) > 1) {
            printf("%s: %.*s\n", arguments[k], (int)errors->table->size(errors),
                   (const char *)errors->table->pointer(errors));
            result = E_FAIL;
        }
        if (result >= 0) {
            ++good;
        } else {
            printf("%s: failed (%08lx)\n", arguments[k], (unsigned long)result);
            ++bad;
        }
        if (errors) errors->table->release(errors);
        if (code) code->table->release(code);
        free(text);
    }
    printf("compiled %d, failed %d\n", good, bad);
    fflush(stdout);
    TerminateProcess(GetCurrentProcess(), bad ? 1 : 0);
    return 0;
}
