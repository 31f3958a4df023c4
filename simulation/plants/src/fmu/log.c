/* The logger of FMI 2 has a variable number of arguments, which a function of Rust cannot have: this one makes the text of them. */
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>

/* Of journal.rs. All pointers but `text` may be null. */
void luna_plants_fmu_logged(void *environment, int status, const char *category, const char *text);

void luna_plants_fmu_log(void *environment, const char *instance, int status, const char *category, const char *format, ...) {
    char text[1024] = "";
    (void)instance;
    if (format != NULL) {
        va_list arguments;
        va_start(arguments, format);
        vsnprintf(text, sizeof text, format, arguments);
        va_end(arguments);
    }
    luna_plants_fmu_logged(environment, status, category, text);
}
