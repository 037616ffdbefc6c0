//! Addresses that persons type and paste.

use carom_farm::net::{JoinUrl, NodeAddress};

/// A text is a sentence without control characters, or an address that is printed as it reads back.
pub fn addresses(bytes: &[u8]) {
    let Ok(text) = str::from_utf8(bytes) else {
        return;
    };
    match text.parse::<JoinUrl>() {
        Ok(url) => {
            let again = url.to_string().parse::<JoinUrl>().expect("its own text");
            assert_eq!(again, url);
            // Whatever is behind the farm's fingerprint is a secret.
            let told = format!("{url:?}");
            let digits = told.rsplit('#').next().unwrap_or_default();
            assert_eq!(digits.trim_end_matches("\")").len(), 32, "{told}");
        }
        Err(why) => assert_plain(&why.to_string()),
    }
    match text.parse::<NodeAddress>() {
        Ok(address) => {
            let again = address.to_string().parse::<NodeAddress>();
            assert_eq!(again.expect("its own text"), address);
        }
        Err(why) => assert_plain(&why.to_string()),
    }
}

fn assert_plain(sentence: &str) {
    assert!(!sentence.chars().any(char::is_control), "{sentence:?}");
}

/// Names, both kinds of numbers, and a token with and without its secret.
pub fn addresses_seeds() -> Vec<Vec<u8>> {
    let token = "0123456789abcdef".repeat(4);
    [
        "oak.example:4433".to_owned(),
        "127.0.0.1:1".to_owned(),
        "[fe80::1]:65535".to_owned(),
        format!("farm://oak:4434#{token}"),
        format!("farm://[::1]:4434#{}", &token[..32]),
    ]
    .map(String::into_bytes)
    .into()
}
