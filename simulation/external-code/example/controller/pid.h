/* Sub-model PID: interface.
 *
 * The arrays are the caller's: inputs u, outputs y, states x and parameters p.
 */
#ifndef PID_H
#define PID_H

#define PID_INPUTS 2
#define PID_OUTPUTS 1
#define PID_STATES 4
#define PID_PARAMETERS 5

void pid_initialize(const double *u, double *y, double *x, double *p, double t);
void pid_step(const double *u, double *y, double *x, double *p, double t);

#endif
