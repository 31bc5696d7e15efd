/* Depth of the probe -> stress by the response map -> spikes, for the playground in the browser.

   The page fills depth_um, knot_um and polynomial and calls encode; it then reads stress_pa,
   spike_sample and spike_cell. The map is SciPy's: a polynomial between two knots, of the distance
   from the lower one, its terms summed from the constant on. */
#include "afferents.h"

#define EXPORTED(name) __attribute__((export_name(name)))

enum { SAMPLES = 20001, KNOTS = 64, COMPONENTS = 4, TERMS = 4, SPIKES = 400000 };

static double depth_um[SAMPLES], stress_pa[AFFERENTS_CLASSES][SAMPLES];
static double knot_um[KNOTS];
static double polynomial[KNOTS][AFFERENTS_CLASSES][COMPONENTS][TERMS]; /* constant term first */
static int spike_sample[SPIKES], spike_cell[SPIKES]; /* cell: of all classes, from 0 */
static afferents state;

EXPORTED("depth_um") double *depth_address(void) { return depth_um; }
EXPORTED("stress_pa") double *stress_address(void) { return stress_pa[0]; }
EXPORTED("knot_um") double *knot_address(void) { return knot_um; }
EXPORTED("polynomial") double *polynomial_address(void) { return polynomial[0][0][0]; }
EXPORTED("spike_sample") int *sample_address(void) { return spike_sample; }
EXPORTED("spike_cell") int *cell_address(void) { return spike_cell; }
EXPORTED("most_samples") int most_samples(void) { return SAMPLES; }

static double von_mises(double xx, double yy, double zz, double xy)
{
    const double a = xx - yy, b = yy - zz, c = zz - xx;
    return AFFERENTS_ROOT(0.5 * (a * a + b * b + c * c) + 3.0 * (xy * xy));
}

static double stress_at(double depth, int knots, int afferent)
{
    double component[COMPONENTS];
    int low = 0, high = knots - 1, k, term;
    if (depth < knot_um[0]) depth = knot_um[0]; /* the probe has left the skin */
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        if (depth < knot_um[middle]) high = middle;
        else low = middle;
    }
    for (k = 0; k < COMPONENTS; k++) {
        const double *coefficient = polynomial[low][afferent][k];
        const double distance = depth - knot_um[low];
        double sum = 0.0, power = 1.0;
        for (term = 0; term < TERMS; term++) {
            sum = sum + coefficient[term] * power;
            power *= distance;
        }
        component[k] = sum;
    }
    return von_mises(component[0], component[1], component[2], component[3]);
}

/* Stress and spikes of the first `samples` depths; the number of spikes, -1 where they are too
   many. A spike of sample n is n AFFERENTS_SENSOR_MS after the first sample. */
EXPORTED("encode") int encode(int samples, int knots)
{
    int n, k, spikes = 0;
    afferents_init(&state);
    for (n = 0; n < samples; n++) {
        unsigned char fired[AFFERENTS_ROOM];
        double now[AFFERENTS_CLASSES];
        for (k = 0; k < AFFERENTS_CLASSES; k++) {
            now[k] = stress_at(depth_um[n], knots, k);
            stress_pa[k][n] = now[k];
        }
        if (!afferents_step(&state, now, fired)) continue;
        for (k = 0; k < AFFERENTS_ROOM; k++) {
            for (; fired[k]; fired[k]--) {
                if (spikes == SPIKES) return -1;
                spike_sample[spikes] = n;
                spike_cell[spikes++] = k;
            }
        }
    }
    return spikes;
}
