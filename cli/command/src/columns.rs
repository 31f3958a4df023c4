//! Text in columns, without borders.

use comfy_table::presets::NOTHING;
use comfy_table::{CellAlignment, ColumnConstraint, Table, Width};

/// No line of a text is longer.
pub const WIDTH: u16 = 110;

/// Rows of numbers below each other. The first column is text.
pub fn of_numbers<const N: usize>(
    head: [&str; N],
    rows: impl IntoIterator<Item = [String; N]>,
) -> String {
    of_rows(head, &Vec::from_iter(1..N), rows)
}

/// Rows of texts, each column as wide as it has to be; numbers in the columns `right`.
pub fn of_rows<const N: usize>(
    head: [&str; N],
    right: &[usize],
    rows: impl IntoIterator<Item = [String; N]>,
) -> String {
    let mut table = Table::new();
    table.load_style(NOTHING).add_row(head).add_rows(rows);
    for (number, column) in table.column_iter_mut().enumerate() {
        column.set_padding((if number == 0 { 0 } else { 2 }, 0));
        if right.contains(&number) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    lines(&table)
}

/// Rows of texts, which go on below their first word. The last column has the rest of [`WIDTH`].
pub fn of_texts<const N: usize>(
    widths: [u16; N],
    rows: impl IntoIterator<Item = Vec<String>>,
) -> String {
    let mut table = Table::new();
    table.load_style(NOTHING).add_rows(rows);
    let rest = WIDTH - widths.iter().sum::<u16>();
    for (column, width) in table
        .column_iter_mut()
        .zip(widths.into_iter().chain([rest]))
    {
        column.set_padding((0, 0));
        column.set_constraint(ColumnConstraint::Absolute(Width::Fixed(width)));
    }
    lines(&table)
}

fn lines(table: &Table) -> String {
    table.trim_fmt() + "\n"
}
