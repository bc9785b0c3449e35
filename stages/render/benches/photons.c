/* One photon packet after the other through a half-space of n = 1, in double precision: the algorithm of MCML (Wang, Jacques and Zheng, Computer Methods and Programs in
   Biomedicine 47, 131-146, 1995) without its layers. At each collision the albedo is taken off the weight and what is absorbed is tallied by radius and depth; below a weight of
   1e-4 one packet of ten survives a roulette. Random numbers are xoshiro256+, which take less time than MCML's subtractive generator.

   photons MU_A MU_S G COUNT: prints flights, CPU seconds and the diffuse reflectance. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { RADII = 128, DEPTHS = 128 };
static const double STEP = 0.05; /* mm, of radius and depth */

static uint64_t state[4] = {0x9e3779b97f4a7c15u, 0xbf58476d1ce4e5b9u, 0x94d049bb133111ebu, 0x2545f4914f6cdd1du};

static uint64_t turned(uint64_t x, int by) { return (x << by) | (x >> (64 - by)); }

/* In (0, 1]. */
static double uniform(void) {
    uint64_t result = state[0] + state[3], shifted = state[1] << 17;
    state[2] ^= state[0];
    state[3] ^= state[1];
    state[1] ^= state[2];
    state[0] ^= state[3];
    state[2] ^= shifted;
    state[3] = turned(state[3], 45);
    return ((double)(result >> 11) + 1.0) * 0x1p-53;
}

static double cosine_of_scattering(double g) {
    if (g == 0.0) return 2.0 * uniform() - 1.0;
    double t = (1.0 - g * g) / (1.0 - g + 2.0 * g * uniform());
    return (1.0 + g * g - t * t) / (2.0 * g);
}

int main(int count_of_words, char **words) {
    if (count_of_words != 5) return 2;
    double mu_a = atof(words[1]), mu_s = atof(words[2]), g = atof(words[3]), mu_t = mu_a + mu_s;
    long count = atol(words[4]);
    static double absorbed[RADII][DEPTHS], escaped[RADII];
    memset(absorbed, 0, sizeof absorbed);
    double reflectance = 0.0;
    long flights = 0;
    clock_t began = clock();
    for (long i = 0; i < count; i++) {
        double x = 0, y = 0, z = 0, ux = 0, uy = 0, uz = 1, weight = 1;
        for (;;) {
            double step = -log(uniform()) / mu_t;
            flights++;
            if (uz < 0 && step * uz <= -z) { /* out of the surface, where indices match */
                double way = -z / uz;
                x += way * ux;
                y += way * uy;
                int at = (int)(sqrt(x * x + y * y) / STEP);
                escaped[at < RADII ? at : RADII - 1] += weight;
                reflectance += weight;
                break;
            }
            x += step * ux;
            y += step * uy;
            z += step * uz;
            double lost = weight * mu_a / mu_t;
            weight -= lost;
            int radius = (int)(sqrt(x * x + y * y) / STEP), depth = (int)(z / STEP);
            absorbed[radius < RADII ? radius : RADII - 1][depth < DEPTHS ? depth : DEPTHS - 1] += lost;
            double c = cosine_of_scattering(g), s = sqrt(fmax(0.0, 1.0 - c * c));
            double phi = 6.283185307179586 * uniform(), cos_phi = cos(phi);
            double sin_phi = phi < 3.141592653589793 ? sqrt(1.0 - cos_phi * cos_phi) : -sqrt(1.0 - cos_phi * cos_phi);
            if (fabs(uz) > 0.99999) {
                ux = s * cos_phi;
                uy = s * sin_phi;
                uz = uz < 0 ? -c : c;
            } else {
                double root = sqrt(1.0 - uz * uz);
                double vx = s * (ux * uz * cos_phi - uy * sin_phi) / root + ux * c;
                double vy = s * (uy * uz * cos_phi + ux * sin_phi) / root + uy * c;
                uz = -s * cos_phi * root + uz * c;
                ux = vx;
                uy = vy;
            }
            if (weight < 1e-4) {
                if (uniform() > 0.1) break;
                weight *= 10.0;
            }
        }
    }
    double seconds = (double)(clock() - began) / CLOCKS_PER_SEC;
    printf("%ld %.6f %.6f\n", flights, seconds, reflectance / (double)count);
    return 0;
}
