/* A software GPU for the programs in this folder: Mesa's, by a surfaceless EGL context. Where there is none they end
   with 77, which says "skipped". */
#include <EGL/egl.h>
#include <GL/gl.h>
#include <GL/glext.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

typedef void(APIENTRYP BINDTEXTURE)(GLenum, GLuint);
typedef void(APIENTRYP CLEAR)(GLbitfield);
typedef void(APIENTRYP CLEARCOLOR)(GLfloat, GLfloat, GLfloat, GLfloat);
typedef void(APIENTRYP CULLFACE)(GLenum);
typedef void(APIENTRYP DELETETEXTURES)(GLsizei, const GLuint *);
typedef void(APIENTRYP DEPTHFUNC)(GLenum);
typedef void(APIENTRYP DRAWARRAYS)(GLenum, GLint, GLsizei);
typedef void(APIENTRYP ENABLE)(GLenum);
typedef void(APIENTRYP FINISH)(void);
typedef void(APIENTRYP GENTEXTURES)(GLsizei, GLuint *);
typedef GLenum(APIENTRYP GETERROR)(void);
typedef void(APIENTRYP GETINTEGERV)(GLenum, GLint *);
typedef void(APIENTRYP PIXELSTOREI)(GLenum, GLint);
typedef void(APIENTRYP READBUFFER)(GLenum);
typedef void(APIENTRYP READPIXELS)(GLint, GLint, GLsizei, GLsizei, GLenum, GLenum, void *);
typedef void(APIENTRYP TEXIMAGE2D)(GLenum, GLint, GLint, GLsizei, GLsizei, GLint, GLenum, GLenum, const void *);
typedef void(APIENTRYP TEXPARAMETERI)(GLenum, GLenum, GLint);
typedef void(APIENTRYP TEXSUBIMAGE2D)(GLenum, GLint, GLint, GLint, GLsizei, GLsizei, GLenum, GLenum, const void *);
typedef void(APIENTRYP VIEWPORT)(GLint, GLint, GLsizei, GLsizei);
#define GL_FUNCTIONS(X)                                                                                              \
    X(PFNGLACTIVETEXTUREPROC, ActiveTexture) X(PFNGLATTACHSHADERPROC, AttachShader)                                  \
    X(PFNGLBINDBUFFERPROC, BindBuffer) X(PFNGLBINDBUFFERBASEPROC, BindBufferBase)                                    \
    X(PFNGLBINDFRAMEBUFFERPROC, BindFramebuffer) X(PFNGLBINDIMAGETEXTUREPROC, BindImageTexture)                      \
    X(BINDTEXTURE, BindTexture) X(PFNGLBINDVERTEXARRAYPROC, BindVertexArray) X(PFNGLBUFFERDATAPROC, BufferData)      \
    X(PFNGLCHECKFRAMEBUFFERSTATUSPROC, CheckFramebufferStatus) X(CLEAR, Clear)                                       \
    X(PFNGLCLEARBUFFERFVPROC, ClearBufferfv) X(CLEARCOLOR, ClearColor) X(PFNGLCOMPILESHADERPROC, CompileShader)      \
    X(PFNGLCREATEPROGRAMPROC, CreateProgram) X(PFNGLCREATESHADERPROC, CreateShader) X(CULLFACE, CullFace)            \
    X(PFNGLDELETEBUFFERSPROC, DeleteBuffers) X(PFNGLDELETEPROGRAMPROC, DeleteProgram)                                \
    X(PFNGLDELETESHADERPROC, DeleteShader) X(DELETETEXTURES, DeleteTextures)                                         \
    X(PFNGLDISPATCHCOMPUTEPROC, DispatchCompute) X(DRAWARRAYS, DrawArrays)                                           \
    X(PFNGLDRAWARRAYSINSTANCEDPROC, DrawArraysInstanced) X(PFNGLDRAWBUFFERSPROC, DrawBuffers) X(ENABLE, Enable)      \
    X(FINISH, Finish) X(PFNGLFRAMEBUFFERTEXTURE2DPROC, FramebufferTexture2D) X(PFNGLGENBUFFERSPROC, GenBuffers)      \
    X(PFNGLGENFRAMEBUFFERSPROC, GenFramebuffers) X(GENTEXTURES, GenTextures)                                         \
    X(PFNGLGENVERTEXARRAYSPROC, GenVertexArrays) X(GETERROR, GetError) X(GETINTEGERV, GetIntegerv)                   \
    X(PFNGLGETPROGRAMINFOLOGPROC, GetProgramInfoLog) X(PFNGLGETPROGRAMIVPROC, GetProgramiv)                          \
    X(PFNGLGETSHADERINFOLOGPROC, GetShaderInfoLog) X(PFNGLGETSHADERIVPROC, GetShaderiv)                              \
    X(PFNGLGETUNIFORMBLOCKINDEXPROC, GetUniformBlockIndex) X(PFNGLGETUNIFORMLOCATIONPROC, GetUniformLocation)        \
    X(PFNGLLINKPROGRAMPROC, LinkProgram) X(PFNGLMAPBUFFERRANGEPROC, MapBufferRange)                                  \
    X(PFNGLMEMORYBARRIERPROC, MemoryBarrier) X(PIXELSTOREI, PixelStorei) X(READBUFFER, ReadBuffer)                   \
    X(READPIXELS, ReadPixels) X(PFNGLSHADERSOURCEPROC, ShaderSource) X(PFNGLTEXBUFFERPROC, TexBuffer)                \
    X(TEXIMAGE2D, TexImage2D) X(PFNGLTEXIMAGE3DPROC, TexImage3D) X(TEXPARAMETERI, TexParameteri)                     \
    X(PFNGLTEXSTORAGE2DPROC, TexStorage2D) X(TEXSUBIMAGE2D, TexSubImage2D)                                           \
    X(PFNGLTEXSUBIMAGE3DPROC, TexSubImage3D) X(PFNGLUNIFORM1FPROC, Uniform1f) X(PFNGLUNIFORM1IPROC, Uniform1i)       \
    X(PFNGLUNIFORM2FPROC, Uniform2f) X(PFNGLUNIFORM2IPROC, Uniform2i) X(PFNGLUNIFORM3FPROC, Uniform3f)               \
    X(PFNGLUNIFORM4FPROC, Uniform4f) X(PFNGLUNIFORM4IPROC, Uniform4i)                                                \
    X(PFNGLUNIFORMBLOCKBINDINGPROC, UniformBlockBinding) X(PFNGLUNIFORMMATRIX4FVPROC, UniformMatrix4fv)              \
    X(PFNGLUNMAPBUFFERPROC, UnmapBuffer) X(PFNGLUSEPROGRAMPROC, UseProgram) X(VIEWPORT, Viewport)                    \
    X(PFNGLCLIPCONTROLPROC, ClipControl) X(DEPTHFUNC, DepthFunc) X(ENABLE, Disable)
#define GL_FIELD(type, name) type name;
static struct {
    GL_FUNCTIONS(GL_FIELD)
} gl;

static int failures;

static void wrong(const char *format, ...)
{
    va_list arguments;
    ++failures;
    va_start(arguments, format);
    vprintf(format, arguments);
    va_end(arguments);
    printf("\n");
    fflush(stdout);
}

static void context(int es)
{
    static const EGLint core[] = {EGL_CONTEXT_MAJOR_VERSION,       4,
                                  EGL_CONTEXT_MINOR_VERSION,       5,
                                  EGL_CONTEXT_OPENGL_PROFILE_MASK, EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                  EGL_NONE};
    static const EGLint three[] = {EGL_CONTEXT_MAJOR_VERSION, 3, EGL_CONTEXT_MINOR_VERSION, 1, EGL_NONE};
    EGLDisplay display = eglGetDisplay(EGL_DEFAULT_DISPLAY);
    EGLContext made = EGL_NO_CONTEXT;
    GLuint array;
    if (display != EGL_NO_DISPLAY && eglInitialize(display, NULL, NULL)) {
        eglBindAPI(es ? EGL_OPENGL_ES_API : EGL_OPENGL_API);
        made = eglCreateContext(display, (EGLConfig)0, EGL_NO_CONTEXT, es ? three : core); /* no surface, no config */
    }
    if (made == EGL_NO_CONTEXT || !eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, made)) {
        printf("no surfaceless context\n");
        exit(77);
    }
#define GL_FIND(type, name) gl.name = (type)eglGetProcAddress("gl" #name);
    GL_FUNCTIONS(GL_FIND)
    gl.GenVertexArrays(1, &array);
    gl.BindVertexArray(array);
    gl.PixelStorei(GL_UNPACK_ALIGNMENT, 1);
}

static GLuint shader(GLenum stage, const char *text)
{
    GLuint name = gl.CreateShader(stage);
    GLint good = 0;
    gl.ShaderSource(name, 1, &text, NULL);
    gl.CompileShader(name);
    gl.GetShaderiv(name, GL_COMPILE_STATUS, &good);
    if (!good) {
        char log[2000] = "";
        gl.GetShaderInfoLog(name, sizeof log, NULL, log);
        wrong("%s\n%s", text, log);
        exit(1);
    }
    return name;
}

/* A linked program of two shaders, or of one and 0. */
static GLuint program(GLuint first, GLuint second)
{
    GLuint name = gl.CreateProgram();
    GLint good = 0;
    gl.AttachShader(name, first);
    if (second) gl.AttachShader(name, second);
    gl.LinkProgram(name);
    gl.GetProgramiv(name, GL_LINK_STATUS, &good);
    if (!good) {
        char log[2000] = "";
        gl.GetProgramInfoLog(name, sizeof log, NULL, log);
        wrong("link: %s", log);
        exit(1);
    }
    return name;
}
