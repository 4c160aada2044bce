"""Arithmetic on 4-vectors that stays in one vector register on the CPU.

A plain Warp expression over vec4 reaches LLVM as sixteen scalars, which its vectoriser only half puts together again
(adjoint loops ran two times slower). These snippets say it in clang's vector type; on CUDA they are plain arithmetic.
"""

from types import SimpleNamespace

import warp as wp

# Warp reads annotations as values, which mypy cannot:
# mypy: ignore-errors

LOAD = """
#if defined(__CUDA_ARCH__)
    return {plain};
#else
    typedef {c} lanes __attribute__((ext_vector_type(4)));
    lanes {loads};
    lanes r = {fast};
    wp::vec_t<4, {c}> out;
    __builtin_memcpy(&out, &r, sizeof(r));
    return out;
#endif
"""

SCATTER = """
#if defined(__CUDA_ARCH__)
    wp::atomic_add(&nodes.data[n], wp::mul(s, a));
#else
    typedef SCALAR lanes __attribute__((ext_vector_type(4)));
    lanes sum, a_;
    __builtin_memcpy(&sum, &nodes.data[n], sizeof(sum));
    __builtin_memcpy(&a_, &a, sizeof(a_));
    sum = sum + s * a_;
    __builtin_memcpy(&nodes.data[n], &sum, sizeof(sum));
#endif
"""


def build(real: type) -> SimpleNamespace:
    """Functions over scalar type `real`: scaled, madd, madd_each, gather, scatter."""
    vec4 = wp.types.vector(4, real)
    c = "float" if real is wp.float32 else "double"

    def snippet(plain: str, fast: str, *operands: str) -> str:
        loads = ", ".join(f"{o}_" for o in operands) + ";" + "".join(f" __builtin_memcpy(&{o}_, &{o}, sizeof({o}_));" for o in operands)
        return LOAD.format(c=c, plain=plain, fast=fast, loads=loads)

    @wp.func_native(snippet("wp::mul(s, a)", "s * a_", "a"))
    def scaled(s: real, a: vec4) -> vec4: ...

    @wp.func_native(snippet("wp::add(a, wp::mul(s, b))", "a_ + s * b_", "a", "b"))
    def madd(a: vec4, s: real, b: vec4) -> vec4: ...

    @wp.func_native(snippet("wp::add(a, wp::cw_mul(b, d))", "a_ + b_ * d_", "a", "b", "d"))
    def madd_each(a: vec4, b: vec4, d: vec4) -> vec4: ...

    @wp.func_native("return nodes.data[n];")
    def gather(nodes: wp.array(dtype=vec4), n: int) -> vec4: ...

    @wp.func_native(SCATTER.replace("SCALAR", c))
    def scatter(nodes: wp.array(dtype=vec4), n: int, s: real, a: vec4): ...

    return SimpleNamespace(scaled=scaled, madd=madd, madd_each=madd_each, gather=gather, scatter=scatter)
