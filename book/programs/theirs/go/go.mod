module theirs

go 1.18
