//! Common parts of all reports: a single file that works without a network.

use super::plot::Plot;
use maud::{DOCTYPE, Markup, PreEscaped, html};

/// Colours that are distinguishable with colour blindness and in print: the palette of Okabe and Ito without yellow.
/// The first four belong to the kinds of controllers, in their order.
pub(crate) const COLOURS: [&str; 7] = [
    "#0072b2", "#d55e00", "#aa4499", "#009e73", "#e69f00", "#56b4e9", "#000000",
];

/// A report.
pub(crate) struct ReportPage<'a> {
    pub(crate) title: &'a str,
    pub(crate) subtitle: &'a str,
    /// Conclusions, one sentence each.
    pub(crate) conclusions: &'a [String],
    pub(crate) body: Markup,
    /// Further rules of style.
    pub(crate) style: &'a str,
}

impl ReportPage<'_> {
    /// Returns the page: XHTML that browsers read as HTML.
    pub(crate) fn html(&self) -> String {
        // A comment in HTML; in XHTML it keeps `<` and `&` from being markup.
        let style = |css: &str| PreEscaped(format!("/*<![CDATA[*/{css}/*]]>*/"));
        let script = |js: &str| PreEscaped(format!("//<![CDATA[\n{js}\n//]]>"));
        let page = html! {
            (DOCTYPE)
            html xmlns="http://www.w3.org/1999/xhtml" lang="en" {
                head {
                    (PreEscaped("<meta charset=\"utf-8\"/>"))
                    (PreEscaped("<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>"))
                    title { (self.title) }
                    style { (style(include_str!("uplot/uPlot.min.css"))) }
                    style { (style(include_str!("style.css"))) (style(self.style)) }
                }
                body {
                    h1 { (self.title) }
                    p.subtitle { (self.subtitle) }
                    @for conclusion in self.conclusions {
                        p.finding { (conclusion) }
                    }
                    noscript { p { "The plots need JavaScript; figures and tables do not." } }
                    (self.body)
                    script { (script(include_str!("uplot/uPlot.iife.min.js"))) }
                    script { (script(include_str!("report.js"))) }
                }
            }
        };
        page.into_string()
    }
}

/// Returns a section: heading, what is to be seen, and plots that share a cursor with all others of the page.
pub(crate) fn section(title: &str, caption: &str, legend: &Markup, plots: &[Plot]) -> Markup {
    html! {
        h2 { (title) }
        figure {
            figcaption { (caption) }
            (legend)
            @for plot in plots {
                (plot.markup("time"))
            }
        }
    }
}

/// Returns names with their colours.
pub(crate) fn legend_of(names: &[(&str, &str)]) -> Markup {
    html! {
        div.legend {
            @for (name, colour) in names {
                span { span.swatch style={ "background:" (colour) } {} (name) }
            }
        }
    }
}

/// Returns a table whose first column is text and whose others are numbers.
pub(crate) fn table(id: &str, header: &[&str], rows: &[Vec<String>]) -> Markup {
    html! {
        div.scroll {
            table id=(id) {
                thead {
                    tr {
                        @for (index, name) in header.iter().enumerate() {
                            th.name[index == 0] { (name) }
                        }
                    }
                }
                tbody {
                    @for row in rows {
                        tr {
                            @for (index, cell) in row.iter().enumerate() {
                                @if index == 0 {
                                    th.name scope="row" { (cell) }
                                } @else {
                                    td { (cell) }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}
