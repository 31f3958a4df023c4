/* Sub-model PID, in the form in which controllers come out of code generators: names by index, one statement an equation.
 *
 *   u[0]  set-point, rad          y[0]  duty, 1
 *   u[1]  angle, rad
 *
 *   x[0]  integral, 1             p[0]  kp, 1/rad
 *   x[1]  filtered speed, rad/s   p[1]  ki, 1/(rad s)
 *   x[2]  angle before, rad       p[2]  kd, s/rad
 *   x[3]  time before, s          p[3]  filter, s
 *                                 p[4]  limit, 1
 */
#include "pid.h"

/* initial equations */
void pid_initialize(const double *u, double *y, double *x, double *p, double t)
{
    /* parameters */
    p[0] = 1.2;
    p[1] = 6.0;
    p[2] = 0.02;
    p[3] = 0.002;
    p[4] = 0.6;

    /* states */
    x[0] = 0.0;
    x[1] = 0.0;
    x[2] = u[1];
    x[3] = t;

    /* outputs */
    y[0] = 0.0;
}

/* dynamic equations, each sample */
void pid_step(const double *u, double *y, double *x, double *p, double t)
{
    double h, error, rest, grown, output;

    /* static equations */
    h = t - x[3];
    error = u[0] - u[1];

    /* rate equations */
    if (h > 0.0)
    {
        x[1] = x[1] + ((u[1] - x[2]) / h - x[1]) * h / (p[3] + h);
    }
    rest = p[0] * error - p[2] * x[1];
    grown = x[0] + p[1] * error * h;
    if (!((rest + grown > p[4] && error > 0.0) || (rest + grown < -p[4] && error < 0.0)))
    {
        x[0] = grown;
    }

    /* output equations */
    output = rest + x[0];
    if (output > p[4])
    {
        output = p[4];
    }
    if (output < -p[4])
    {
        output = -p[4];
    }
    y[0] = output;

    /* states of the next sample */
    x[2] = u[1];
    x[3] = t;
}
