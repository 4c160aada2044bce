"""Arithmetic on 4-vectors that stays in one vector register on the CPU, and moves of them in one piece on CUDA.

A plain Warp expression over vec4 reaches LLVM as sixteen scalars, which its vectoriser only half puts together again
(adjoint loops ran two times slower). These snippets say it in clang's vector type. On CUDA they are plain arithmetic,
except that `scatter` adds a whole vector at once where the chip can (compute capability 9.0).
"""

from types import SimpleNamespace

import warp as wp

# Warp reads annotations as values; mypy knows neither them nor what follows from them:
# mypy: disable-error-code="valid-type"

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

# A vector moves in one piece: Warp's vectors are aligned to their scalars, so that CUDA takes them apart otherwise.
GET = """
#if defined(__CUDA_ARCH__)
    {quad} q = *reinterpret_cast<const {quad}*>(&{from});
    return wp::vec_t<4, {c}>(q.x, q.y, q.z, q.w);
#else
    return {from};
#endif
"""

PUT = """
#if defined(__CUDA_ARCH__)
    {quad} q = {{a[0], a[1], a[2], a[3]}};
    *reinterpret_cast<{quad}*>(&{to}) = q;
#else
    {to} = a;
#endif
"""

QUAD = {"float": "float4", "double": "double4"}
OF_NODE, OF_SLOT = "nodes.data[n]", "states.data[size_t(slot) * states.shape[1] + n]"

# Nothing in a kernel reads what it scatters: without a memory clobber the compiler may load the next nodes meanwhile.
SCATTER = """
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900 && VECTOR_RED
    asm volatile("{ .reg .u64 g; cvta.to.global.u64 g, %0; red.global.add.v4.f32 [g], {%1, %2, %3, %4}; }"
        :: "l"(&nodes.data[n]), "f"(s * a[0]), "f"(s * a[1]), "f"(s * a[2]), "f"(s * a[3]));
#elif defined(__CUDA_ARCH__)
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
    """Functions over scalar type `real`: scaled, madd, madd_each; get, put, scatter (on nodes); recall, keep (in slots)."""
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

    @wp.func_native(GET.format(c=c, quad=QUAD[c], **{"from": OF_NODE}))
    def get(nodes: wp.array(dtype=vec4), n: int) -> vec4: ...

    @wp.func_native(PUT.format(quad=QUAD[c], to=OF_NODE))
    def put(nodes: wp.array(dtype=vec4), n: int, a: vec4): ...

    @wp.func_native(GET.format(c=c, quad=QUAD[c], **{"from": OF_SLOT}))
    def recall(states: wp.array2d(dtype=vec4), slot: int, n: int) -> vec4: ...

    @wp.func_native(PUT.format(quad=QUAD[c], to=OF_SLOT))
    def keep(states: wp.array2d(dtype=vec4), slot: int, n: int, a: vec4): ...

    @wp.func_native(SCATTER.replace("SCALAR", c).replace("VECTOR_RED", str(int(real is wp.float32))))
    def scatter(nodes: wp.array(dtype=vec4), n: int, s: real, a: vec4): ...

    return SimpleNamespace(scaled=scaled, madd=madd, madd_each=madd_each, get=get, put=put, recall=recall, keep=keep, scatter=scatter)
