/* What the kernels in C stand on: arrays, numbers as Python and numpy have them, sorting, the way in and out. */

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>

#if defined(__GNUC__)
#define INLINE static inline __attribute__((always_inline))
#define KERNEL static __attribute__((unused))
#define UNALIGNED __attribute__((aligned(1)))
#else
#define INLINE static __forceinline
#define KERNEL static
#define UNALIGNED
#endif

typedef double UNALIGNED f8u;
typedef float UNALIGNED f4u;
typedef int64_t UNALIGNED i8u;
typedef int32_t UNALIGNED i4u;
typedef uint16_t UNALIGNED u2u;

/* Up to three axes of n cells, s bytes apart; `owner` is the bytearray behind it, or NULL if a caller's. */
typedef struct {
    char *p;
    int64_t n0, n1, n2, s0, s1, s2;
    PyObject *owner;
} Array;

typedef struct {
    int64_t f0, f1;
} Range;

enum { DIVISION = 1, MEMORY = 2, EMPTY = 3, NEGATIVE = 4 };

/* Arrays */

INLINE void keep(Array *slot, Array value) {
    Py_XINCREF(value.owner);
    Py_XDECREF(slot->owner);
    *slot = value;
}

INLINE void take(Array *slot, Array value) {
    Py_XDECREF(slot->owner);
    *slot = value;
}

INLINE Array kept(Array value) {
    Py_XINCREF(value.owner);
    return value;
}

static Array shaped(int64_t size, int axes, int64_t n0, int64_t n1, int64_t n2, int *bad) {
    Array made = {0};
    int64_t whole = size * n0 * (axes > 1 ? n1 : 1) * (axes > 2 ? n2 : 1);
    made.n0 = n0, made.n1 = n1, made.n2 = n2;
    if (n0 < 0 || (axes > 1 && n1 < 0) || (axes > 2 && n2 < 0)) {
        *bad = NEGATIVE;
        whole = made.n0 = made.n1 = made.n2 = 0;
    }
    made.s2 = size;
    made.s1 = axes > 2 ? size * made.n2 : size;
    made.s0 = axes > 1 ? made.s1 * made.n1 : size;
    made.owner = PyByteArray_FromStringAndSize(NULL, (Py_ssize_t)(whole > 8 ? whole : 8));
    if (made.owner) made.p = PyByteArray_AsString(made.owner);
    else *bad = MEMORY, made.n0 = made.n1 = made.n2 = 0;
    return made;
}

static Array zeroed(int64_t size, int axes, int64_t n0, int64_t n1, int64_t n2, int *bad) {
    Array made = shaped(size, axes, n0, n1, n2, bad);
    if (made.p) memset(made.p, 0, (size_t)PyByteArray_Size(made.owner));
    return made;
}

INLINE int64_t wrap(int64_t i, int64_t n) { return i < 0 ? i + n : i; }

INLINE Array at(Array a, int axis, int64_t i) {
    if (axis == 0) a.p += i * a.s0, a.n0 = a.n1, a.s0 = a.s1, a.n1 = a.n2, a.s1 = a.s2;
    else if (axis == 1) a.p += i * a.s1, a.n1 = a.n2, a.s1 = a.s2;
    else a.p += i * a.s2;
    return a;
}

INLINE int64_t clamped(int64_t i, int64_t n) {
    i = i < 0 ? i + n : i;
    return i < 0 ? 0 : i > n ? n : i;
}

INLINE Array cut(Array a, int axis, int64_t start, int64_t stop) {
    int64_t n = axis == 0 ? a.n0 : axis == 1 ? a.n1 : a.n2;
    start = clamped(start, n);
    n = clamped(stop, n) - start;
    n = n < 0 ? 0 : n;
    if (axis == 0) a.p += start * a.s0, a.n0 = n;
    else if (axis == 1) a.p += start * a.s1, a.n1 = n;
    else a.p += start * a.s2, a.n2 = n;
    return a;
}

INLINE Array reversed(Array a) {
    if (a.n0) a.p += (a.n0 - 1) * a.s0;
    a.s0 = -a.s0;
    return a;
}

INLINE Array raveled(Array a, int axes) {
    a.n0 *= axes > 1 ? a.n1 : 1;
    a.n0 *= axes > 2 ? a.n2 : 1;
    a.s0 = axes > 2 ? a.s2 : axes > 1 ? a.s1 : a.s0;
    return a;
}

/* Numbers */

INLINE double quotient(double a, double b, int *bad) {
    if (b == 0.0) {
        *bad = DIVISION;
        return 0.0;
    }
    return a / b;
}

INLINE float quotientf(float a, float b, int *bad) {
    if (b == 0.0f) {
        *bad = DIVISION;
        return 0.0f;
    }
    return a / b;
}

INLINE int64_t floored(int64_t a, int64_t b) {
    int64_t whole = a / b, rest = a % b;
    return whole - (rest != 0 && (rest ^ b) < 0);
}

INLINE int64_t modulo(int64_t a, int64_t b) {
    int64_t rest = a % b;
    return rest != 0 && (rest ^ b) < 0 ? rest + b : rest;
}

INLINE int64_t floored_checked(int64_t a, int64_t b, int *bad) {
    if (b == 0) {
        *bad = DIVISION;
        return 0;
    }
    return floored(a, b);
}

INLINE int64_t modulo_checked(int64_t a, int64_t b, int *bad) {
    if (b == 0) {
        *bad = DIVISION;
        return 0;
    }
    return modulo(a, b);
}

INLINE double min_f8(double a, double b) { return b < a ? b : a; }
INLINE double max_f8(double a, double b) { return b > a ? b : a; }
INLINE float min_f4(float a, float b) { return b < a ? b : a; }
INLINE float max_f4(float a, float b) { return b > a ? b : a; }
INLINE int64_t min_i8(int64_t a, int64_t b) { return b < a ? b : a; }
INLINE int64_t max_i8(int64_t a, int64_t b) { return b > a ? b : a; }
INLINE int64_t abs_i8(int64_t a) { return a < 0 ? -a : a; }
INLINE double square(double a) { return a * a; }
INLINE int64_t square_i8(int64_t a) { return a * a; }
INLINE double minimum(double a, double b) { return a != a ? a : b != b ? b : a <= b ? a : b; }
INLINE double maximum(double a, double b) { return a != a ? a : b != b ? b : a >= b ? a : b; }

INLINE double remainder_of(double a, double b) {
    double rest = fmod(a, b);
    return rest + (rest != 0.0 && (b < 0.0) != (rest < 0.0) ? b : 0.0);
}

/* Order: the algorithms of numba, whose order of equals follows from them */

#define LESS_f8(a, b) ((a) < (b) || ((a) == (a) && (b) != (b)))
#define LESS_i8(a, b) ((a) < (b))

#define QUICKSORT(NAME, ITEM, LESS, GET)                                                                     \
    static void NAME(const char *keys, int64_t s, ITEM *r, int64_t count) {                                 \
        int64_t stack[100][2], n = 1;                                                                        \
        (void)keys, (void)s;                                                                                 \
        stack[0][0] = 0, stack[0][1] = count - 1;                                                            \
        while (n > 0) {                                                                                      \
            n--;                                                                                             \
            int64_t low = stack[n][0], high = stack[n][1];                                                   \
            while (high - low >= 15) {                                                                       \
                int64_t middle = (low + high) >> 1, i = low, j = high - 1;                                   \
                ITEM t;                                                                                      \
                if (LESS(GET(r[middle]), GET(r[low]))) t = r[low], r[low] = r[middle], r[middle] = t;        \
                if (LESS(GET(r[high]), GET(r[middle]))) t = r[high], r[high] = r[middle], r[middle] = t;     \
                if (LESS(GET(r[middle]), GET(r[low]))) t = r[low], r[low] = r[middle], r[middle] = t;        \
                ITEM pivot = r[middle];                                                                      \
                t = r[high], r[high] = r[middle], r[middle] = t;                                             \
                for (;;) {                                                                                   \
                    while (i < high && LESS(GET(r[i]), GET(pivot))) i++;                                     \
                    while (j >= low && LESS(GET(pivot), GET(r[j]))) j--;                                     \
                    if (i >= j) break;                                                                       \
                    t = r[i], r[i] = r[j], r[j] = t;                                                         \
                    i++, j--;                                                                                \
                }                                                                                            \
                t = r[i], r[i] = r[high], r[high] = t;                                                       \
                if (high - i > i - low) {                                                                    \
                    if (high > i) stack[n][0] = i + 1, stack[n][1] = high, n++;                              \
                    high = i - 1;                                                                            \
                } else {                                                                                     \
                    if (i > low) stack[n][0] = low, stack[n][1] = i - 1, n++;                                \
                    low = i + 1;                                                                             \
                }                                                                                            \
            }                                                                                                \
            for (int64_t i = low + 1; i <= high; i++) {                                                      \
                ITEM one = r[i];                                                                             \
                int64_t j = i;                                                                               \
                for (; j > low && LESS(GET(one), GET(r[j - 1])); j--) r[j] = r[j - 1];                       \
                r[j] = one;                                                                                  \
            }                                                                                                \
        }                                                                                                    \
    }

#define ITSELF(one) (one)
#define KEY_f8(one) (*(const double *)(keys + (one) * s))

QUICKSORT(quick_f8, double, LESS_f8, ITSELF)
QUICKSORT(quick_i8, int64_t, LESS_i8, ITSELF)
QUICKSORT(argquick_f8, int64_t, LESS_f8, KEY_f8)

static void argmerge_f8(const char *keys, int64_t s, int64_t *r, int64_t count, int64_t *space) {
    if (count > 20) {
        int64_t middle = count / 2, i = 0, j = middle, k = 0;
        argmerge_f8(keys, s, r, middle, space);
        argmerge_f8(keys, s, r + middle, count - middle, space);
        memcpy(space, r, (size_t)middle * sizeof(int64_t));
        while (i < middle && j < count) r[k++] = LESS_f8(KEY_f8(r[j]), KEY_f8(space[i])) ? r[j++] : space[i++];
        while (i < middle) r[k++] = space[i++];
        return;
    }
    for (int64_t i = 1; i < count; i++)
        for (int64_t j = i; j > 0 && LESS_f8(KEY_f8(r[j]), KEY_f8(r[j - 1])); j--) {
            int64_t t = r[j - 1];
            r[j - 1] = r[j], r[j] = t;
        }
}

static Array argsorted(Array keys, int stable, int *bad) {
    Array order = shaped(8, 1, keys.n0, 0, 0, bad);
    int64_t *r = (int64_t *)order.p;
    if (!r) return order;
    for (int64_t i = 0; i < keys.n0; i++) r[i] = i;
    if (!stable) argquick_f8(keys.p, keys.s0, r, keys.n0);
    else {
        Array space = shaped(8, 1, keys.n0 / 2, 0, 0, bad);
        if (space.p) argmerge_f8(keys.p, keys.s0, r, keys.n0, (int64_t *)space.p);
        Py_XDECREF(space.owner);
    }
    return order;
}

INLINE int64_t searched_f8(Array a, double value, int right) {
    int64_t low = 0, high = a.n0;
    while (low < high) {
        int64_t middle = low + ((high - low) >> 1);
        double one = *(double *)(a.p + middle * a.s0);
        if (right ? !LESS_f8(value, one) : LESS_f8(one, value)) low = middle + 1;
        else high = middle;
    }
    return low;
}

INLINE int64_t searched_i8(Array a, int64_t value, int right) {
    int64_t low = 0, high = a.n0;
    while (low < high) {
        int64_t middle = low + ((high - low) >> 1), one = *(int64_t *)(a.p + middle * a.s0);
        if (right ? one <= value : one < value) low = middle + 1;
        else high = middle;
    }
    return low;
}

/* Sorts a contiguous copy in place and shortens it to its distinct values. */
static void make_distinct(Array *sorted) {
    int64_t *r = (int64_t *)sorted->p, count = 0;
    quick_i8(NULL, 0, r, sorted->n0);
    for (int64_t i = 0; i < sorted->n0; i++)
        if (i == 0 || r[i] != r[i - 1]) r[count++] = r[i];
    sorted->n0 = count;
}

/* The middle of a contiguous copy, which is sorted. */
static double median_of(Array copy) {
    double *r = (double *)copy.p;
    quick_f8(NULL, 0, r, copy.n0);
    if (copy.n0 == 0) return NAN;
    return copy.n0 & 1 ? r[copy.n0 >> 1] : (r[(copy.n0 >> 1) - 1] + r[copy.n0 >> 1]) / 2.0;
}

/* In and out */

typedef struct {
    Py_buffer views[32];
    PyObject *objects[32];
    int count, failed;
} Call;

enum { F8, F4, I8, I4, U1, B1, KINDS };
PyObject *box_array(Call *call, Array a, int axes, int kind);
PyObject *pack(int count, ...);
Array array_of(Call *call, PyObject *object);
PyObject *end_call(Call *call, PyObject *result);
void raise(int bad);

INLINE double f8_of(Call *call, PyObject *object) {
    double value = PyFloat_AsDouble(object);
    call->failed |= value == -1.0 && PyErr_Occurred();
    return value;
}

INLINE int64_t i8_of(Call *call, PyObject *object) {
    int64_t value = PyLong_AsLongLong(object);
    call->failed |= value == -1 && PyErr_Occurred();
    return value;
}
