/* Random numbers that depend on a key and a counter alone. */

#include <stdint.h>

/* Philox 4x64-10: Salmon et al., "Parallel random numbers: as easy as 1, 2, 3" (2011). */
static void philox(const uint64_t key, const uint64_t counter, uint64_t word[4])
{
    const uint64_t a = 0xD2E7470EE14C6C93, b = 0xCA5A826395121157;
    uint64_t k0 = key, k1 = 0;
    word[0] = counter;
    word[1] = word[2] = word[3] = 0;
    for (int round = 0; round < 10; round++) {
        const unsigned __int128 ax = (unsigned __int128)a * word[0], by = (unsigned __int128)b * word[2];
        const uint64_t first = (uint64_t)(by >> 64) ^ word[1] ^ k0, third = (uint64_t)(ax >> 64) ^ word[3] ^ k1;
        word[0] = first;
        word[1] = (uint64_t)by;
        word[2] = third;
        word[3] = (uint64_t)ax;
        k0 += 0x9E3779B97F4A7C15;
        k1 += 0xBB67AE8584CAA73B;
    }
}

/* Two of a step's four words give a point, a number per half: its upper 24 bits, which float32 represents exactly. */
static void draw(uint64_t key, uint64_t counter, Py_ssize_t n, float *u)
{
    for (Py_ssize_t step = 0; step < n / 2; step++) {
        uint64_t word[4];
        philox(key, counter + (uint64_t)step + 1, word);
        for (int i = 0; i < 4; i++) {
            float *to = u + 2 * (i % 2) * n + 2 * step + i / 2;
            to[0] = (float)(int32_t)((uint32_t)word[i] >> 8) * 0x1p-24f;
            to[n] = (float)(int32_t)(word[i] >> 40) * 0x1p-24f;
        }
    }
}
