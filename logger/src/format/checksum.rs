//! CRC-32 as in zlib, PNG and Ethernet (reflected, polynomial 0xEDB88320), so that any language has it at hand.

/// Eight tables: the effect of a byte that lies so many bytes back.
const TABLES: [[u32; 256]; 8] = tables();

const fn tables() -> [[u32; 256]; 8] {
    let mut tables = [[0; 256]; 8];
    let mut byte = 0;
    while byte < 256 {
        let mut value = byte as u32;
        let mut bit = 0;
        while bit < 8 {
            value = (value >> 1) ^ (0xEDB8_8320 & 0u32.wrapping_sub(value & 1));
            bit += 1;
        }
        tables[0][byte] = value;
        byte += 1;
    }
    let mut back = 1;
    while back < 8 {
        let mut byte = 0;
        while byte < 256 {
            let before = tables[back - 1][byte];
            tables[back][byte] = (before >> 8) ^ tables[0][(before & 0xFF) as usize];
            byte += 1;
        }
        back += 1;
    }
    tables
}

/// The checksum of several pieces, one after the other. O(bytes).
pub(crate) fn crc32(pieces: &[&[u8]]) -> u32 {
    !pieces.iter().fold(!0, |state, piece| update(state, piece))
}

fn update(mut state: u32, bytes: &[u8]) -> u32 {
    let (eights, rest) = bytes.as_chunks::<8>();
    for [a, b, c, d, e, f, g, h] in eights {
        let low = state ^ u32::from_le_bytes([*a, *b, *c, *d]);
        state = TABLES[7][(low & 0xFF) as usize]
            ^ TABLES[6][(low >> 8 & 0xFF) as usize]
            ^ TABLES[5][(low >> 16 & 0xFF) as usize]
            ^ TABLES[4][(low >> 24) as usize]
            ^ TABLES[3][usize::from(*e)]
            ^ TABLES[2][usize::from(*f)]
            ^ TABLES[1][usize::from(*g)]
            ^ TABLES[0][usize::from(*h)];
    }
    rest.iter().fold(state, |state, byte| {
        (state >> 8) ^ TABLES[0][((state ^ u32::from(*byte)) & 0xFF) as usize]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_published_check_value() {
        assert_eq!(crc32(&[b"123456789"]), 0xCBF4_3926);
        assert_eq!(crc32(&[]), 0);
    }

    #[test]
    fn pieces_are_as_the_whole() {
        let whole: Vec<u8> = (0..100u8).collect();
        for cut in 0..whole.len() {
            let (one, two) = whole.split_at(cut);
            assert_eq!(crc32(&[one, two]), crc32(&[&whole]));
        }
    }
}
