// A ray marcher as fast as one gets by hand, without a bound: sixteen rays of four by four pixels in the lanes of
// AVX-512, the midpoint rule in single precision, a table of the transfer function, empty blocks of 8^3 skipped.
#include <immintrin.h>
#include <cstdint>

#ifndef __AVX512F__
#error this processor has no AVX-512
#endif

typedef __m512 vf;
typedef __m512i vi;

static inline vf set(float a) { return _mm512_set1_ps(a); }
static inline vi seti(int a) { return _mm512_set1_epi32(a); }

// Rays are (tiles, 6, 16) origins and directions in index coordinates; samples and blocks have three bytes more; the
// table has four rows of ``entries``, colours times opacity and opacity of a step, ``fine`` of them a grey level.
extern "C" void march(const uint8_t* samples, const int* size, const uint8_t* seen, const float* table, int entries,
    float fine, const float* rays, int first, int last, float step, float clear, float* image) {
    const int nx = size[0], nxy = size[0] * size[1];
    const int across[2] = {(size[0] + 6) / 8, (size[1] + 6) / 8};
    const vf zero = set(0.0f), one = set(1.0f);
    const vi byte = seti(255);
    for (int tile = first; tile < last; ++tile) {
        vf o[3], d[3], inverse[3], most[3], near = zero, far = set(1e30f);
        __mmask16 up[3];
        for (int a = 0; a < 3; ++a) {
            o[a] = _mm512_loadu_ps(rays + (tile * 6 + a) * 16);
            d[a] = _mm512_loadu_ps(rays + (tile * 6 + 3 + a) * 16);
            inverse[a] = _mm512_div_ps(one, d[a]);
            up[a] = _mm512_cmp_ps_mask(d[a], zero, _CMP_GT_OQ);
            most[a] = set(size[a] - 1.0001f);
            const vf p = _mm512_mul_ps(_mm512_sub_ps(zero, o[a]), inverse[a]);
            const vf q = _mm512_mul_ps(_mm512_sub_ps(set(size[a] - 1.0f), o[a]), inverse[a]);
            near = _mm512_max_ps(near, _mm512_min_ps(p, q));
            far = _mm512_min_ps(far, _mm512_max_ps(p, q));
        }
        vf T = one, color[3] = {zero, zero, zero}, t = _mm512_add_ps(near, set(0.5f * step));
        __mmask16 alive = _mm512_cmp_ps_mask(t, far, _CMP_LT_OQ);
        while (alive) {
            vf p[3];
            vi cell[3], block[3];
            for (int a = 0; a < 3; ++a) {
                p[a] = _mm512_min_ps(_mm512_max_ps(_mm512_fmadd_ps(t, d[a], o[a]), zero), most[a]);
                cell[a] = _mm512_cvttps_epi32(p[a]);
                block[a] = _mm512_srli_epi32(cell[a], 3);
            }
            const vi at = _mm512_add_epi32(block[0], _mm512_mullo_epi32(seti(across[0]),
                _mm512_add_epi32(block[1], _mm512_mullo_epi32(seti(across[1]), block[2]))));
            const vi full = _mm512_mask_i32gather_epi32(seti(0), alive, at, (const int*)seen, 1);
            const __mmask16 here = _mm512_mask_test_epi32_mask(alive, full, byte);
            // Each lane leaves an empty block by itself, by whole steps.
            vf steps = one;
            if (here != alive) {
                vf leave = set(1e30f);
                for (int a = 0; a < 3; ++a) {
                    const vi next = _mm512_mask_add_epi32(block[a], up[a], block[a], seti(1));
                    const vf face = _mm512_cvtepi32_ps(_mm512_slli_epi32(next, 3));
                    leave = _mm512_min_ps(leave, _mm512_mul_ps(_mm512_sub_ps(face, p[a]), inverse[a]));
                }
                const vf whole = _mm512_roundscale_ps(_mm512_mul_ps(leave, set(1.0f / step)), 2);
                steps = _mm512_mask_max_ps(one, _mm512_knot(here), one, whole);
            }
            if (here) {
                const vi corner = _mm512_add_epi32(cell[0], _mm512_add_epi32(_mm512_mullo_epi32(cell[1], seti(nx)),
                    _mm512_mullo_epi32(cell[2], seti(nxy))));
                vf f[3], edge[4];
                for (int a = 0; a < 3; ++a) f[a] = _mm512_sub_ps(p[a], _mm512_cvtepi32_ps(cell[a]));
                for (int m = 0; m < 4; ++m) {
                    const int* from = (const int*)(samples + (m & 1) * nx + (m >> 1) * nxy);
                    const vi pair = _mm512_mask_i32gather_epi32(seti(0), here, corner, from, 1);
                    const vf low = _mm512_cvtepi32_ps(_mm512_and_si512(pair, byte));
                    const vf high = _mm512_cvtepi32_ps(_mm512_and_si512(_mm512_srli_epi32(pair, 8), byte));
                    edge[m] = _mm512_fmadd_ps(f[0], _mm512_sub_ps(high, low), low);
                }
                for (int m = 0; m < 4; m += 2) edge[m] = _mm512_fmadd_ps(f[1], _mm512_sub_ps(edge[m + 1], edge[m]), edge[m]);
                const vf scalar = _mm512_fmadd_ps(f[2], _mm512_sub_ps(edge[2], edge[0]), edge[0]);
                const vi entry = _mm512_cvtps_epi32(_mm512_mul_ps(scalar, set(fine)));
                const vf A = _mm512_mask_i32gather_ps(zero, here, entry, table + 3 * entries, 4);
                if (_mm512_cmp_ps_mask(A, zero, _CMP_GT_OQ))
                    for (int c = 0; c < 3; ++c)
                        color[c] = _mm512_fmadd_ps(
                            T, _mm512_mask_i32gather_ps(zero, here, entry, table + c * entries, 4), color[c]);
                T = _mm512_fnmadd_ps(T, A, T);
            }
            t = _mm512_fmadd_ps(steps, set(step), t);
            alive &= _mm512_cmp_ps_mask(t, far, _CMP_LT_OQ) & _mm512_cmp_ps_mask(T, set(clear), _CMP_GE_OQ);
        }
        for (int c = 0; c < 4; ++c) _mm512_storeu_ps(image + (tile * 4 + c) * 16, c < 3 ? color[c] : _mm512_sub_ps(one, T));
    }
}
