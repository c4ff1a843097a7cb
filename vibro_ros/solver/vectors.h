// Arrays, tables and vectors of the compiled kernels: what numpy and vector.py are where the same text runs as Python.
//
// A vector is six parts of four doubles. Every operation is number by number, and `total` adds in one fixed order, so
// that the width of the processor's registers changes no bit.
#pragma once
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#if defined(__x86_64__)
#include <cpuid.h>
#endif

#define INLINE static inline __attribute__((always_inline))
#define MEMBER inline __attribute__((always_inline))

// Contiguous arrays of known shape, as `layout.Laid` lists them: address, then lengths.
template <class T> struct Array {
    T *data; long n0;
    MEMBER T &operator[](long i) const { return data[i]; }
    MEMBER Array part(long first, long end) const { return {data + first, end - first}; }
    MEMBER Array tail(long first) const { return {data + first, n0 - first}; }
    MEMBER void fill(T x) const { for (long i = 0; i < n0; i++) data[i] = x; }
};
template <class T> struct Table {
    T *data; long n0, n1;
    MEMBER Array<T> operator[](long i) const { return {data + i * n1, n1}; }
    MEMBER Table part(long first, long end) const { return {data + first * n1, end - first, n1}; }
    MEMBER Table tail(long first) const { return part(first, n0); }
    MEMBER void fill(T x) const { for (long i = 0; i < n0 * n1; i++) data[i] = x; }
};
template <class T> struct Table3 {
    T *data; long n0, n1, n2;
    MEMBER Table<T> operator[](long i) const { return {data + i * n1 * n2, n1, n2}; }
};
template <class T> struct Table4 {
    T *data; long n0, n1, n2, n3;
    MEMBER Table3<T> operator[](long i) const { return {data + i * n1 * n2 * n3, n1, n2, n3}; }
};
// Records: `records[k]` is a reference to one of them.
template <class T> struct Records {
    T *data; long n0;
    MEMBER T *operator[](long i) const { return data + i; }
};

enum { LENGTH = 24 };
typedef double Part __attribute__((vector_size(32)));
typedef double Anywhere __attribute__((vector_size(32), aligned(8)));
typedef int64_t Mask __attribute__((vector_size(32)));

struct Vector {
    Part a, b, c, d, e, f;
    Vector() = default;
    MEMBER Vector(Part a, Part b, Part c, Part d, Part e, Part f) : a(a), b(b), c(c), d(d), e(e), f(f) {}
    MEMBER void operator=(int) {}  // for results that Cython declares and never uses
};

INLINE Part part_at(const double *p) { return *(const Anywhere *)p; }
INLINE void put(double *p, Part x) { *(Anywhere *)p = x; }
INLINE Part four(double x) { return Part{x, x, x, x}; }
INLINE Vector vector(Array<double> array) {
    const double *p = array.data;
    return Vector{part_at(p), part_at(p + 4), part_at(p + 8), part_at(p + 12), part_at(p + 16), part_at(p + 20)};
}
INLINE void store(Array<double> array, Vector v) {
    double *p = array.data;
    put(p, v.a); put(p + 4, v.b); put(p + 8, v.c); put(p + 12, v.d); put(p + 16, v.e); put(p + 20, v.f);
}
#define EACH(OPERATION) Vector{OPERATION(a), OPERATION(b), OPERATION(c), OPERATION(d), OPERATION(e), OPERATION(f)}
#define SUM(k) x.k + y.k
#define DIFFERENCE(k) x.k - y.k
#define PRODUCT(k) x.k * y.k
#define MULTIPLE(k) factor * y.k
#define POSITIVE(k) (Part)((Mask)x.k & (Mask{} + INT64_MAX))
INLINE Vector operator+(Vector x, Vector y) { return EACH(SUM); }
INLINE Vector operator-(Vector x, Vector y) { return EACH(DIFFERENCE); }
INLINE Vector operator*(Vector x, Vector y) { return EACH(PRODUCT); }
INLINE Vector operator*(double s, Vector y) { Part factor = four(s); return EACH(MULTIPLE); }
INLINE Vector repeated(double s) { Part x = four(s); return Vector{x, x, x, x, x, x}; }
INLINE Vector magnitudes(Vector x) { return EACH(POSITIVE); }
INLINE double total(Vector x) {
    Part r = ((x.a + x.c) + x.e) + ((x.b + x.d) + x.f);
    return (r[0] + r[2]) + (r[1] + r[3]);
}
#define UP(low, high) __builtin_shufflevector(low, high, 3, 4, 5, 6)
#define DOWN(low, high) __builtin_shufflevector(low, high, 1, 2, 3, 4)
INLINE Vector raised(Vector x) {
    Part z = four(0.0);
    return Vector{UP(z, x.a), UP(x.a, x.b), UP(x.b, x.c), UP(x.c, x.d), UP(x.d, x.e), UP(x.e, x.f)};
}
INLINE Vector lowered(Vector x) {
    Part z = four(0.0);
    return Vector{DOWN(x.a, x.b), DOWN(x.b, x.c), DOWN(x.c, x.d), DOWN(x.d, x.e), DOWN(x.e, x.f), DOWN(x.f, z)};
}
INLINE Vector with_first(Vector x, double number) { x.a[0] = number; return x; }
INLINE double last(Vector x) { return x.f[3]; }
INLINE Vector powers(double x) {
    double square = x * x, fourth = square * square;
    Part low = Part{1.0, x, square, x * square}, high = low * four(fourth), eighth = four(fourth * fourth);
    Part c = low * eighth, d = high * eighth, e = c * eighth, f = d * eighth;
    return Vector(low, high, c, d, e, f);
}
INLINE long indices_above(Vector x, double limit) {
    Part l = four(limit);
    Mask bit = Mask{1, 2, 4, 8};
    Mask r = ((x.a > l) & bit) | ((x.b > l) & (bit << 4)) | ((x.c > l) & (bit << 8)) | ((x.d > l) & (bit << 12))
           | ((x.e > l) & (bit << 16)) | ((x.f > l) & (bit << 20));
    return (r[0] | r[1]) | (r[2] | r[3]);
}
INLINE long first_index(long bits) { return bits ? __builtin_ctzl((unsigned long)bits) : 64; }
INLINE Table<double> as_column(Array<double> p) { return {p.data, p.n0, 1}; }
INLINE long whole(double x) { return (long)x; }

// Whether the processor has the instructions of x86-64-v3, for which a second build of the kernels exists.
INLINE bool has_wide_registers() {
#if defined(__x86_64__)
    // By instructions, because __builtin_cpu_supports knows nothing where zig compiles.
    unsigned a, b, c, d, saved;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & bit_OSXSAVE) || !(c & bit_FMA)) return false;
    asm("xgetbv" : "=a"(saved), "=d"(d) : "c"(0));
    return (saved & 6) == 6 && __get_cpuid_count(7, 0, &a, &b, &c, &d) && (b & bit_AVX2) && (b & bit_BMI2);
#else
    return false;
#endif
}
