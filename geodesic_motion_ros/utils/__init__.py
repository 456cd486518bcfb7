"""What every floor uses: errors, deadlines, checked files and numbers, tables, shared files."""
